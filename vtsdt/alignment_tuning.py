"""Where the tuning ``likelihood`` comes from: ``python -m vtsdt.alignment_tuning``.

Variances of height, speed, δ and of both readings under which trips of a virtual lift are most likely, as they were
sampled: low-passed readings are not white, and their likelihood means nothing.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vtsdt.alignment import balance
from vtsdt.alignment_filter import DELTA, TUNINGS, GuideFilter, Tuning
from vtsdt.alignment_lifts import prepared, visit
from vtsdt.parameters import LiftParameters

if TYPE_CHECKING:
    from estimation.filters import Tuned

__all__ = ["likely"]

_FREE = ("z", "v_z", "delta")


def likely(
    seed: int = 41, trips: int = 2, steps: int = 25, progress: Callable[[str], Any] = lambda text: None
) -> tuple[Tuning, Tuned]:
    """Return the tuning that makes trips of a virtual lift most likely, beginning from ``quiet``, and how it was found.

    The lateral states keep their noise: the likelihood hardly depends on it.

    Parameters
    ----------
    seed : int
        Of the lift.
    trips : int
        Two or more, up and down in turn.
    steps : int
        At most.
    progress : callable
    """
    from estimation.filters import Samples, tune

    records = visit(seed, 0, trips, progress=progress).records
    smooth, lift = prepared(records), LiftParameters.bench()
    travel = np.linspace(0.1, lift.hoistway.travel - 0.1, 100)
    error = balance(smooth, lift, travel) or 0.0
    sensor = GuideFilter(lift, TUNINGS["quiet"])
    model, names = sensor.model(), {n.rpartition(".")[2]: n for n in sensor.system.state_names}
    names["delta"] = DELTA
    samples = [
        Samples(r["time"], r["tension"] - error, np.column_stack([r["height"], r["acceleration"] - t.offset]))
        for r, t in zip(records, smooth, strict=True)
    ]
    # Each trip has a start of its own, so each is tuned alone; the geometric mean counts.
    found = [
        tune(
            model, part, sensor.noise(), sensor.prior(trip), process=[names[k] for k in _FREE],
            measurement=["z_c", "zdd_c"], steps=steps, progress=progress, once=True,
        )
        for part, trip in zip(samples, smooth, strict=True)
    ]  # fmt: skip
    tables = [np.log(each.to_frame()["tuned"].to_numpy()) for each in found]
    values = np.exp(np.mean(tables, axis=0))
    process = {**TUNINGS["quiet"].process, **dict(zip(_FREE, map(float, values), strict=False))}
    tuning = dataclasses.replace(
        TUNINGS["likelihood"], process=process, height=float(values[3]), acceleration=float(values[4])
    )
    return tuning, found[0]


def main(arguments: Sequence[str] | None = None) -> int:
    """Find the tuning and print it."""
    from vtsdt.progress import Progress

    parser = argparse.ArgumentParser(prog="python -m vtsdt.alignment_tuning", description=__doc__)
    parser.add_argument("--seed", type=int, default=41, help="of the virtual lift (default 41)")
    args = parser.parse_args(arguments)
    with Progress(False) as progress:
        tuning, found = likely(args.seed, progress=progress)
    print(found.to_frame().to_string())
    print({k: tuning.process[k] for k in _FREE}, f"height {tuning.height:.3g}, acceleration {tuning.acceleration:.3g}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
