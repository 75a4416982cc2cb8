"""Error rates of the score scan on simulated axes: false alarms and detections, with Wilson intervals.

    python benchmarks/score_null.py null --records 1 2 4 8 --models 240
    python benchmarks/score_null.py power --records 1 2 4 8 --models 100
    python benchmarks/score_null.py null --records 1 2 --duration 25 --dt 0.001 --models 40

Models start miscalibrated. Beside the calibrated scan, two tests that are common and wrong are run on the
same residuals: χ² on the residual divided by its standard deviation, and χ² after whitening with a plain
autoregression, both with Bonferroni's correction for the number of columns.
"""

from __future__ import annotations

import argparse
import os
import time
from collections import Counter

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.stats import chi2

from discrepancy.statistics.scan import scan
from discrepancy.statistics.whitened import raw_residual, rms_whitener, whiten_all
from discrepancy.statistics.whitening import fit_whitener
from discrepancy.validation import linear_axes

LEVEL = 0.02


def wilson(k: int, n: int) -> tuple[float, float]:
    """95 % interval of a rate."""
    z = 1.959964
    p = k / n
    d = 1 + z * z / n
    centre = (p + z * z / (2 * n)) / d
    half = z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / d
    return max(0.0, centre - half), min(1.0, centre + half)


def show(label: str, k: int, n: int, more: str = "") -> None:
    lo, hi = wilson(k, n)
    print(
        f"{label:58s} {k:4d}/{n:<4d} {100 * k / n:5.1f} %  [{100 * lo:4.1f}, {100 * hi:4.1f}] {more}",
        flush=True,
    )


def chi_square_alarms(case: linear_axes.Case, cands: list) -> tuple[bool, bool]:
    """Alarms of the naive χ² and of the χ² after plain AR whitening."""
    res, sens = case.residual, case.sensitivities
    w = whiten_all(rms_whitener(res), res, sens, cands)
    raw = raw_residual(w, res, sens, cands, ())
    alarms = []
    for order in (0, 24):
        fitted = fit_whitener(raw, res.dt, res.channels, max_order=order, memory=order * res.dt)
        w = whiten_all(fitted, res, sens, cands)
        assert w.scorer is not None
        sigma2 = float(w.e @ w.e) / (w.projection.layout.n_data - w.projection.n_directions)
        s = w.scorer(w.e[:, None])
        p = chi2.sf(s.score[:, 0] / sigma2, w.scorer.kdim) * len(s.score)
        alarms.append(bool(np.min(p) < LEVEL))
    return alarms[0], alarms[1]


def null(args: argparse.Namespace) -> None:
    for n_rec in args.records:
        total = Counter()
        per = args.models // len(args.disturbances)
        t0 = time.perf_counter()
        for d in args.disturbances:
            got: Counter[str] = Counter()
            names: Counter[str] = Counter()
            for s in range(per):
                rng = np.random.default_rng([args.seed, n_rec, s, linear_axes.DISTURBANCES.index(d)])
                axis = linear_axes.make_axis(rng, n_rec, args.duration, args.dt)
                case = linear_axes.make_case(axis, d, rng)
                cands = linear_axes.candidates(axis)
                r = scan(case.residual, case.sensitivities, cands, seed=s, draws=args.draws, level=LEVEL)
                alarm = [x.kind for x in r.rows if x.p_value < LEVEL]
                got["calibrated"] += bool(alarm)
                names.update(alarm[:1])
                if not args.no_peers:
                    naive, white = chi_square_alarms(case, cands)
                    got["naive"] += naive
                    got["white"] += white
            total.update(got)
            show(f"{n_rec} records, {d}: false alarms", got["calibrated"], per, str(dict(names) or ""))
            if not args.no_peers:
                show("      naive χ²", got["naive"], per)
                show("      χ² after AR", got["white"], per)
        n = per * len(args.disturbances)
        show(
            f"{n_rec} records, ALL: false alarms",
            total["calibrated"],
            n,
            f"({(time.perf_counter() - t0) / n:.2f} s per model)",
        )
        if not args.no_peers:
            show(f"{n_rec} records, ALL: naive χ²", total["naive"], n)
            show(f"{n_rec} records, ALL: χ² after AR", total["white"], n)


def power(args: argparse.Namespace) -> None:
    kinds = [k for k in linear_axes.force_laws() if k not in ("coulomb_friction", "viscous_friction", "added_inertia")]
    for n_rec in args.records:
        found: Counter[str] = Counter()
        misses: Counter[str] = Counter()
        n = refused = 0
        for s in range(args.models):
            rng = np.random.default_rng([args.seed + 1, n_rec, s])
            d = linear_axes.DISTURBANCES[s % len(linear_axes.DISTURBANCES)]
            axis = linear_axes.make_axis(rng, n_rec, args.duration, args.dt)
            cands = linear_axes.candidates(axis)
            kind = kinds[int(rng.integers(len(kinds)))]
            cand = next(c for c in cands if c.kind == kind)
            state = rng.bit_generator.state
            r = scan(*_parts(linear_axes.make_case(axis, d, rng)), cands, seed=s, draws=args.draws, level=LEVEL)
            if f"{kind}@guide" in r.refused:
                refused += 1
                continue
            row = r[f"{kind}@guide"]
            size = args.factor * row.smallest_visible_strength
            sign = 1.0 if cand.one_sided else float(rng.choice([-1.0, 1.0]))
            amp = np.zeros(cand.n_strengths)
            amp[0] = sign * size
            rng.bit_generator.state = state
            case = linear_axes.make_case(axis, d, rng, [(kind, dict(row.shape), amp)])
            r = scan(*_parts(case), cands, seed=s, draws=args.draws, level=LEVEL)
            n += 1
            hit = r[f"{kind}@guide"]
            found["detected"] += hit.p_value < LEVEL
            found["first"] += r.rows[0].kind == kind and r.rows[0].p_value < LEVEL
            best = r.rows[0]
            tied = r.ties is not None and any(t.startswith(kind) for t in r.ties.names)
            found["in ties"] += tied or (best.kind == kind and best.p_value < LEVEL)
            found["size"] += abs(hit.expected_strength[0] - amp[0]) < 0.2 * abs(amp[0])
            if not tied and best.kind != kind:
                misses[f"{kind}→{best.kind if best.p_value < LEVEL else 'nothing'}"] += 1
        for what in ("detected", "first", "in ties", "size"):
            show(
                f"{n_rec} records, {args.factor:g} × MDE: {what}",
                found[what],
                n,
                f"{refused} refused; {dict(misses)}" if what == "in ties" else "",
            )


def _parts(case: linear_axes.Case) -> tuple:
    return case.residual, case.sensitivities


def main() -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("what", choices=["null", "power"])
    ap.add_argument("--records", type=int, nargs="+", default=[1, 2, 4, 8])
    ap.add_argument("--models", type=int, default=240)
    ap.add_argument(
        "--disturbances", nargs="+", default=list(linear_axes.DISTURBANCES), choices=linear_axes.DISTURBANCES
    )
    ap.add_argument("--duration", type=float, default=6.0)
    ap.add_argument("--dt", type=float, default=0.005)
    ap.add_argument("--draws", type=int, default=200)
    ap.add_argument("--factor", type=float, default=3.0)
    ap.add_argument("--seed", type=int, default=100)
    ap.add_argument("--no-peers", action="store_true")
    args = ap.parse_args()
    {"null": null, "power": power}[args.what](args)


if __name__ == "__main__":
    main()
