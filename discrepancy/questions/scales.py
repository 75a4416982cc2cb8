"""Sign, size and column of every measured output beside the model's, in the words for what is usually wrong."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from discrepancy.effects.gain_words import gain_in_words
from estimation.files.record import RecordedSignal
from estimation.response.experiment import Experiment, Response
from multibody.base.units import UnitError, same_dimension, si_factor

__all__ = ["Scales", "compare_scales"]

#: Correlation of measured and modelled output above which their ratio is a gain; chosen: the motion is then the same up
#: to a tenth of its power.
SAME_MOTION_CORRELATION = 0.95
#: Correlation below which an output does not follow the model at all, so that another column may.
UNRELATED_CORRELATION = 0.5
#: Correlation beyond which a reversed sign is not what a missing effect does; chosen.
OPPOSITE_CORRELATION = -0.8
#: Product of the shares left unexplained of two columns, exchanged by as they are, below which it is mentioned; chosen.
EXCHANGED_SHARE = 0.5
#: Ratio to the model from which a unit is asked about, and from which it must be wrong: no missing effect does that;
#: chosen.
LARGE_RATIO, IMPOSSIBLE_RATIO = 5.0, 30.0
#: Factor up to which a ratio is that of a unit, where something else is missing too; chosen.
NEAR_UNIT = 1.4
#: Units that loggers write; which of them can be meant follows from dimension and size.
LOGGED_UNITS = (
    *("m", "mm", "cm", "um", "km", "m/s", "mm/s", "km/h", "m/min", "m/s**2", "mm/s**2", "g_0", "rad", "deg", "turn"),
    *("rad/s", "deg/s", "rpm", "turn/s", "N", "kN", "MN", "N*m", "N*mm", "N*cm", "kN*m", "Pa", "kPa", "MPa", "bar"),
    *("mbar", "m**3/s", "l/s", "l/min", "m**3/h", "V", "mV", "kV", "A", "mA", "kA", "W", "kW", "MW", "K", "mK"),
)


@dataclass(frozen=True)
class Scales:
    """What comparing the outputs with the model's has shown.

    Attributes
    ----------
    faults, warnings, facts : list of str
        What makes a comparison meaningless, what weakens it, and what is in order.
    """

    faults: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    facts: list[str] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True)
class _Output:
    """One output beside the model's."""

    name: str
    signal: RecordedSignal
    correlation: float
    gain: float

    @property
    def numbers(self) -> str:
        return f"correlation with the model {self.correlation:.3f}, ratio {self.gain:.4g}"

    @property
    def reversed(self) -> bool:
        return self.correlation < OPPOSITE_CORRELATION

    @property
    def off(self) -> bool:
        """Whether the size is another than a missing effect makes it."""
        large = max(abs(self.gain), 1.0 / abs(self.gain))
        return abs(self.correlation) > UNRELATED_CORRELATION and large > LARGE_RATIO


def compare_scales(experiments: Sequence[Experiment], responses: Sequence[Response]) -> Scales:
    """Compare sign and size of every output with the model's, and with those of the other outputs.

    Parameters
    ----------
    experiments : sequence of Experiment
    responses : sequence of Response
        Their simulations as given.
    """
    scales, names = Scales(), experiments[0].outputs
    measured = [_centred([e.measured[:, c] for e in experiments]) for c in range(len(names))]
    modelled = [_centred([r.outputs[:, c] for r in responses]) for c in range(len(names))]
    alike = np.array([[_correlation(m, y) for y in modelled] for m in measured])
    signals = [experiments[0].record.signals[n] for n in names]
    outputs = []
    swapped = _exchanged(names, signals, alike, scales)
    for c, name in enumerate(names):
        power = float(modelled[c] @ modelled[c])
        if c in swapped:
            continue
        if not float(measured[c] @ measured[c]) > 0.0 or not power > 0.0:
            what = "is constant" if power > 0.0 else "is constant in the model"
            scales.warnings.append(f"'{name}' {what}: nothing can be compared; drive the machine, or leave it out")
            continue
        gain = float(measured[c] @ modelled[c]) / power
        outputs.append(_Output(name=name, signal=signals[c], correlation=float(alike[c, c]), gain=gain))
    inputs = {n: experiments[0].record.signals[n] for n in experiments[0].inputs if n in experiments[0].record.signals}
    if len(outputs) > 1 and _all_alike(outputs):
        scales.faults.append(_of_an_input(outputs, inputs))
        return scales
    for output in outputs:
        _tell(output, scales)
    return scales


def _tell(output: _Output, scales: Scales) -> None:
    """Say how one output compares with the model's."""
    gain, column = output.gain, output.signal.column
    words = gain_in_words(gain - 1.0, gain - 1.0 - 0.02 * abs(gain), gain - 1.0 + 0.02 * abs(gain))
    if output.off:
        # the exact words, where the motion is the same up to a factor; else about how much
        sign = "with the opposite sign and " if output.reversed and not words else ""
        size = words if words and abs(output.correlation) > SAME_MOTION_CORRELATION else f"{sign}{_about(gain)}"
        meant = _meant_unit(output.signal, 1.0 / abs(gain))
        remedy = f"as if its numbers were in {meant}: say so" if meant else "say its unit"
        text = f"'{output.name}': column '{column}' is measured {size} ({output.numbers}), {remedy} "
        text += f'with unit = "{meant or "…"}" in [outputs], or mend the size in model or inputs'
        impossible = max(abs(gain), 1.0 / abs(gain)) > IMPOSSIBLE_RATIO
        (scales.faults if words or impossible else scales.warnings).append(text)
    elif output.reversed:
        scales.faults.append(
            f"'{output.name}': column '{column}' is measured with the opposite sign ({output.numbers}): reverse it in "
            "the file or in the model"
        )
    elif output.correlation < -UNRELATED_CORRELATION:
        scales.warnings.append(
            f"'{output.name}': column '{column}' runs against the model ({output.numbers}): check its sign, and that "
            "of the inputs"
        )
    elif output.correlation < UNRELATED_CORRELATION:
        scales.warnings.append(
            f"'{output.name}': column '{column}' does not follow the model (correlation {output.correlation:.2f}): "
            "another channel, another start, a sensor's offset ([offsets]), or much is missing"
        )
    else:
        scales.facts.append(
            f"'{output.name}' follows the model: correlation {output.correlation:.3f}, ratio {gain:.3g}"
        )


def _all_alike(outputs: Sequence[_Output]) -> bool:
    """Tell whether all outputs are reversed, or off by about one factor: then the inputs are rather at fault."""
    sizes = [abs(output.gain) for output in outputs]
    if all(output.off for output in outputs):
        return max(sizes) < NEAR_UNIT * min(sizes) and len({output.reversed for output in outputs}) == 1
    return all(output.reversed for output in outputs) and not any(output.off for output in outputs)


def _of_an_input(outputs: Sequence[_Output], inputs: dict[str, RecordedSignal]) -> str:
    """Return what to say where all outputs are off alike."""
    gain = math.prod(abs(output.gain) for output in outputs) ** (1.0 / len(outputs))
    reverse, off = outputs[0].reversed, outputs[0].off
    parts = ["with the opposite sign"] if reverse else []
    parts += [_about(gain)] if off else []
    text = f"all outputs are measured {' and '.join(parts)} beside the model: "
    text += "; ".join(f"'{output.name}': {output.numbers}" for output in outputs)
    meant = {n: unit for n, signal in inputs.items() if off and (unit := _meant_unit(signal, gain))}
    which = " or ".join(f"'{n}'" + (f", as if in {meant[n]}" if n in meant else "") for n in (meant or inputs))
    wrong = " and ".join([*(["sign"] if reverse else []), *(["unit"] if off else [])])
    named = f" ({which})" if which else ""
    return f"{text}: rather the {wrong} of an input{named} is wrong, or the model's, than that of every column"


def _about(gain: float) -> str:
    """Return a ratio in words; a power of ten where it is near one."""
    size = max(abs(gain), 1.0 / abs(gain))
    power = 10.0 ** round(math.log10(size))
    near = power if max(size / power, power / size) < NEAR_UNIT else float(f"{size:.2g}")
    return f"about {near:.12g} times too {'large' if abs(gain) > 1.0 else 'small'}"


def _meant_unit(signal: RecordedSignal, ratio: float) -> str:
    """Return the unit whose numbers would be ``ratio`` times those that were read, or an empty text."""
    try:
        wanted = si_factor(signal.measured_unit) * ratio
        near = [(abs(math.log(si_factor(u) / wanted)), u) for u in LOGGED_UNITS if same_dimension(u, signal.unit)]
    except UnitError:
        return ""
    distance, unit = min(near, default=(math.inf, ""))
    return unit if distance < math.log(NEAR_UNIT) else ""


def _exchanged(names: Sequence[str], signals: Sequence[RecordedSignal], alike: np.ndarray, scales: Scales) -> set[int]:
    """Tell which columns look exchanged, and return those that certainly are."""
    certain: set[int] = set()
    for a, b in combinations(range(len(names)), 2):
        own, crossed = np.abs(alike[[a, b], [a, b]]), np.abs(alike[[a, b], [b, a]])
        columns = f"columns '{signals[a].column}' and '{signals[b].column}'"
        others = f"('{names[b]}', '{names[a]}')"
        left = float(np.prod(1.0 - crossed**2)) / max(float(np.prod(1.0 - own**2)), 1e-300)
        if np.all(own < UNRELATED_CORRELATION) and np.all(crossed > SAME_MOTION_CORRELATION):
            certain |= {a, b}
            scales.faults.append(
                f"{columns} look swapped: each follows the other's output {others}: exchange them in [outputs]"
            )
        elif left < EXCHANGED_SHARE and np.all(crossed > UNRELATED_CORRELATION):
            better = f"{crossed[0]:.3f} and {crossed[1]:.3f} in place of {own[0]:.3f} and {own[1]:.3f}"
            scales.warnings.append(
                f"{columns} may be swapped: together they follow each other's outputs {others} better, with "
                f"correlations of {better}: exchange them in [outputs] if that is so"
            )
    return certain


def _centred(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Return the parts without their means, each a record, one after the other."""
    return np.concatenate([part - part.mean() for part in parts])


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 0.0 else 0.0
