"""What the records of a machine say together: posteriors, changes, and the machine's state in words.

A pure function of the judgements in the order of their time: a record that comes late, twice or out of order gives the
same as if it had come at its time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from operation.follow.settings import YEAR, FollowSettings
from operation.statistics.change_size import ChangeSize, change_size
from operation.statistics.control_chart import LONGEST_RUN, Change, control_chart
from operation.statistics.local_level import Level, between_records, local_level
from operation.store.judgement import Judgement

__all__ = ["STATES", "FoundChange", "MachineState", "watch"]

#: States in words, the worst last.
STATES = ("as expected", "drifting", "something new", "no data")
#: Kinds of quantities of which changes are looked for; virtual signals follow from parameters and trips.
WATCHED = ("parameter", "misfit", "feature")
#: Records from which a quantity is watched: a level and its spread have to be seen before anything can differ.
FEWEST = 6
#: Multiple of the usual time between records after which a machine counts as silent.
SILENT = 5.0
#: Share of failed checks among the last records from which the model has stopped being right, and of how many records.
FAILED_SHARE, FAILED_OF = 0.5, 6


@dataclass(frozen=True, eq=False, kw_only=True)
class FoundChange:
    """A change of a quantity.

    Parameters
    ----------
    quantity, kind, unit : str
    change : Change
        With indices into the records of the trace.
    size : ChangeSize
        For a misfit, of its logarithm.
    since, raised : float, s
        Estimated change point, and the record that showed it.
    """

    quantity: str
    kind: str
    unit: str
    change: Change
    size: ChangeSize
    since: float
    raised: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Trace:
    """A quantity over the records that have it.

    Parameters
    ----------
    name, kind, unit : str
    times : ndarray, shape (n,), s
    values, stds : ndarray, shape (n,)
        What each record says by itself.
    level : Level or None
        Posterior after each record; for parameters and features.
    between : float
        Deviation between records beyond their own.
    changes : tuple of FoundChange
        Since the reference.
    reference : float
        Median of the records before the first change.
    """

    name: str
    kind: str
    unit: str
    times: np.ndarray
    values: np.ndarray
    stds: np.ndarray
    level: Level | None
    between: float
    changes: tuple[FoundChange, ...]
    reference: float

    @property
    def now(self) -> tuple[float, float]:
        """Latest posterior: mean and deviation."""
        if self.level is not None and len(self.level.mean):
            return float(self.level.mean[-1]), float(self.level.std[-1])
        return float(self.values[-1]), 0.0

    def probability_above(self, limit: float) -> float:
        """Return the probability that the quantity is above a limit now."""
        mean, std = self.now
        if not std > 0.0:
            return float(mean > limit)
        return 0.5 * math.erfc((limit - mean) / (std * math.sqrt(2.0)))


@dataclass(frozen=True, eq=False, kw_only=True)
class MachineState:
    """A machine as its records show it.

    Parameters
    ----------
    word : str
        One of `STATES`.
    reasons : tuple of str
        Why, a sentence each.
    traces : mapping of str to Trace
    records, refused : int
    last : float, s
        Time of the latest record; minus infinity without one.
    records_per_alarm : float
        Records of a quantity between false alarms.
    """

    word: str
    reasons: tuple[str, ...]
    traces: Mapping[str, Trace]
    records: int
    refused: int
    last: float
    records_per_alarm: float = math.nan
    checks_failed: tuple[str, ...] = field(default=())

    @property
    def changes(self) -> tuple[FoundChange, ...]:
        """All changes, in the order in which they were shown."""
        every = [c for trace in self.traces.values() for c in trace.changes]
        return tuple(sorted(every, key=lambda c: (c.raised, c.quantity)))


def watch(
    judgements: Sequence[Judgement],
    settings: FollowSettings,
    priors: Mapping[str, tuple[float, float]] | None = None,
    *,
    reference_from: float = -math.inf,
    now: float | None = None,
) -> MachineState:
    """Return what the records of a machine say together.

    Parameters
    ----------
    judgements : sequence of Judgement
        In any order.
    settings : FollowSettings
    priors : mapping of str to (float, float), optional
        Of parameters, before the first record: those of the study or of a fleet.
    reference_from : float, s
        Since when the machine is what it is compared with: the last repair.
    now : float, s, optional
        To tell whether the machine is silent; None: it is not asked.
    """
    ordered = sorted(judgements, key=lambda j: (j.at, j.key))
    good = [j for j in ordered if not j.refused]
    last = ordered[-1].at if ordered else -math.inf
    names: dict[str, None] = {}
    for j in good:
        names.update(dict.fromkeys(j.quantities))
    watched = [n for n in names if any(j.quantities[n].kind in WATCHED for j in good if n in j.quantities)]
    rate = settings.records_per_year or _records_per_year([j.at for j in good])
    per_alarm = min(max(rate * max(len(watched), 1) / settings.false_alarms, 2.0), LONGEST_RUN)
    traces = {n: _trace(n, good, settings, priors or {}, per_alarm, reference_from, n in watched) for n in names}
    failed = _failed_checks(good)
    word, reasons = _state(traces, failed)
    if now is not None and good:
        interval = settings.silent or SILENT * YEAR / rate
        if now - last > interval:
            word = "no data"
            reasons = (f"the last record is {(now - last) / 86400.0:.3g} days old", *reasons)
    if not good:
        word, reasons = "no data", ("no record could be judged",)
    return MachineState(
        word=word,
        reasons=reasons,
        traces=traces,
        records=len(good),
        refused=len(ordered) - len(good),
        last=last,
        records_per_alarm=per_alarm,
        checks_failed=failed,
    )


def _records_per_year(times: Sequence[float]) -> float:
    """Return records a year from the median time between them; daily where fewer than three are known."""
    gaps = np.diff(np.asarray(times))
    gaps = gaps[gaps > 0.0]
    return float(YEAR / np.median(gaps)) if gaps.size >= 2 else 365.25


def _trace(
    name: str,
    judgements: Sequence[Judgement],
    settings: FollowSettings,
    priors: Mapping[str, tuple[float, float]],
    per_alarm: float,
    reference_from: float,
    watched: bool,
) -> Trace:
    own = [j for j in judgements if name in j.quantities]
    times = np.array([j.at for j in own])
    given = [j.quantities[name] for j in own]
    values, stds = np.array([q.value for q in given]), np.array([q.std for q in given])
    kind, unit = given[-1].kind, given[-1].unit
    between = between_records(values, stds)
    level = None
    if kind in ("parameter", "feature"):
        prior = priors.get(name, (0.0, math.inf))
        yearly = settings.drift.get(name, prior[1] if math.isfinite(prior[1]) else _usual_drift(values))
        level = local_level(times, values, stds, prior, yearly / math.sqrt(YEAR), between)
    changes: tuple[FoundChange, ...] = ()
    reference = float(np.median(values))
    if watched and values.size >= FEWEST:
        charted = np.log(np.maximum(values, 1e-300)) if kind == "misfit" else values.copy()
        charted[~np.isfinite(stds) | (times < reference_from)] = np.nan
        conditions = _conditions(own)
        first = int(np.searchsorted(times, reference_from))
        found_changes = []
        begin = first
        chart = control_chart(charted, per_alarm, conditions)
        ends = [*(later.since for later in chart[1:]), values.size][: len(chart)]
        for c, end in zip(chart, ends, strict=True):
            end = max(end, c.found + 1)
            size = change_size(times[:end], charted[:end], c.since, begin)
            found_changes.append(
                FoundChange(
                    quantity=name,
                    kind=kind,
                    unit=unit,
                    change=c,
                    size=size,
                    since=float(times[c.since]),
                    raised=float(times[c.found]),
                )
            )
            begin = c.since
        changes = tuple(found_changes)
        end = changes[0].change.since if changes else values.size
        reference = float(np.median(values[first:end])) if end > first else reference
    return Trace(
        name=name,
        kind=kind,
        unit=unit,
        times=times,
        values=values,
        stds=stds,
        level=level,
        between=between,
        changes=changes,
        reference=reference,
    )


def _usual_drift(values: np.ndarray) -> float:
    """Return a drift for a quantity of which nothing is stated: in a year, the spread of its first records."""
    return float(np.std(values[:FEWEST])) if values.size >= 3 else 0.0


def _conditions(judgements: Sequence[Judgement]) -> np.ndarray | None:
    names = sorted({n for j in judgements for n, q in j.quantities.items() if q.kind == "condition"})
    if not names:
        return None
    table = np.array([[j.quantities[n].value if n in j.quantities else np.nan for n in names] for j in judgements])
    means = np.nanmean(table, axis=0)
    return np.where(np.isfinite(table), table, means)


def _failed_checks(judgements: Sequence[Judgement]) -> tuple[str, ...]:
    """Return the outputs whose predictive checks fail in most of the last records."""
    last = [j for j in judgements if j.checks][-FAILED_OF:]
    if len(last) < FAILED_OF:
        return ()
    outputs = dict.fromkeys(o for j in last for o in j.checks)

    return tuple(
        o
        for o in outputs
        if sum(o in j.checks and not j.checks[o].get("passed", True) for j in last) > FAILED_SHARE * len(last)
    )


def _state(traces: Mapping[str, Trace], failed: Sequence[str]) -> tuple[str, tuple[str, ...]]:
    from multibody.base.quantity_text import quantity_text

    new, drifting = [], []
    for trace in traces.values():
        for c in trace.changes:
            day = f"{np.datetime64(int(c.since), 's')}"[:10]
            if c.kind == "misfit":
                factor = math.exp(c.size.size) if math.isfinite(c.size.size) else math.nan
                grown = "grown" if c.change.up else "fallen"
                new.append(f"the {c.quantity} has {grown} since {day}, by a factor of {factor:.2g}")
                continue
            direction = "risen" if c.change.up else "fallen"
            by = ""
            if math.isfinite(c.size.size):
                by = f" by {quantity_text(abs(c.size.size), c.unit, 2)} ± {quantity_text(c.size.std, c.unit, 1)}"
            how = "" if c.size.shape == "not known" else f", {c.size.shape}"
            drifting.append(f"{c.quantity} has {direction} since {day}{by}{how}")
    new += [f"the predictive checks of {o} fail: the model no longer explains it" for o in failed]
    reasons = (*new, *drifting)
    word = "something new" if new else ("drifting" if drifting else "as expected")
    return word, reasons or ("every record agrees with those before it",)
