"""``vtsdt validate fleet``: a year of a simulated fleet of lifts, judged, watched and compared with its truth."""

from __future__ import annotations

import time
from argparse import Namespace
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from multibody.base.json_file import write_json_atomically
from operation.fleet.follow_fleet import FleetRun, follow_fleet
from operation.fleet.scores import MachineYear, Scores, detection_curve, scores, share_interval
from operation.page.page import write_page
from operation.store.store import Store
from vtsdt.fleet.advice import lift_advice
from vtsdt.fleet.simulated_year import SimulatedFleet, judge_visit
from vtsdt.fleet.visit import DEVIATIONS, WORK
from vtsdt.fleet.year_scores import machine_years

__all__ = ["validate_fleet"]

#: Days since the beginning at which the detection curve is stated.
CURVE = (7, 14, 28, 42, 56, 84, 112)


def validate_fleet(args: Namespace) -> int:
    """Simulate, judge and score a fleet; visits that the folder has already are not simulated again.

    Parameters
    ----------
    args : namespace
        ``lifts``, ``visits``, ``seed``, ``false_alarms``, ``workers``, ``out``, ``quiet``, ``progress``.
    """
    fleet = SimulatedFleet(lifts=args.lifts, visits=args.visits, seed=args.seed)
    out = Path(args.out)
    begun = time.perf_counter()
    with Store(out) as store:
        known = {f"{m}/{j.key}" for m in store.machines for j in store.judgements(m)}
        wanted = [v for v in fleet.all_visits() if f"{v.machine}/{v.seed}-{v.number}" not in known]
        args.progress(f"{len(wanted)} visits to simulate and judge")
        run = follow_fleet(judge_visit, wanted, store, workers=args.workers, progress=args.progress)
        years, states = machine_years(fleet, store, args.false_alarms)
        page = write_page(
            out / "machines.html",
            store,
            states,
            title="A simulated fleet of lifts (synthetic data)",
            trends=(*DEVIATIONS, WORK),
            advice=lift_advice,
        )
    scored, rate = scores(years)
    content = {
        "synthetic": True,
        "lifts": fleet.lifts,
        "visits": fleet.visits,
        "seed": fleet.seed,
        "stated_false_alarms": args.false_alarms,
        "seconds_of_wall_clock": time.perf_counter() - begun,
        "processor_seconds_per_visit": run.seconds_per_record if run.records else None,
        "failed": list(run.faults),
        "false_alarms": rate,
        "scores": [_as_json(s, years) for s in scored],
        "machines": [
            {"machine": y.machine, "truth": y.truth, "begins": y.begins, "alarms": list(y.alarms), "named": y.named}
            for y in years
        ],
    }
    write_json_atomically(out / "fleet.json", content)
    if not args.quiet:
        _print(scored, rate, run, args.false_alarms)
        print(f"page: {page}")
    return 0


def _as_json(s: Scores, years: Sequence[MachineYear]) -> dict[str, Any]:
    curve = detection_curve(years, s.truth, np.array(CURVE, dtype=float))

    def number(value: float) -> float | None:
        return float(value) if np.isfinite(value) else None

    return {
        "truth": s.truth,
        "machines": s.machines,
        "detected": s.detected,
        "detected_interval": list(share_interval(s.detected, s.machines)),
        "median_days": number(s.median_days),
        "quartiles_days": [number(v) for v in s.quartiles],
        "right_name": s.right,
        "right_name_interval": list(share_interval(s.right, s.detected)) if s.detected else None,
        "detection_curve": [
            {"days": day, "share": number(a), "interval": [number(b), number(c)]}
            for day, (a, b, c) in zip(CURVE, curve, strict=True)
        ],
    }


def _print(found: Sequence[Scores], rate: Mapping[str, Any], run: FleetRun, stated: float) -> None:
    print(f"{'what happened':28s} {'lifts':>5s} {'found':>5s} {'days (median, quartiles)':>26s} {'right name':>10s}")
    for s in found:
        days = f"{s.median_days:.0f} ({s.quartiles[0]:.0f} to {s.quartiles[1]:.0f})" if s.detected else ""
        print(f"{s.truth:28s} {s.machines:5d} {s.detected:5d} {days:>26s} {s.right:5d} of {s.detected}")
    low, high = rate["interval"]
    print(
        f"false alarms: {rate['false_alarms']} in {rate['machine_years']:.1f} machine years without a change, "
        f"{rate['per_year']:.2f} a year ({low:.2f} to {high:.2f}); stated {stated:g}"
    )
    if run.records:
        print(f"{run.records} visits, {run.seconds_per_record:.2f} s of processor time each, simulation included")
