"""What is known of a force or an error that is some function of the machine's state, by no law of the catalogue."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from discrepancy.evidence.policy import POLICY

if TYPE_CHECKING:
    from discrepancy.evidence.predictive import PredictiveGain
    from discrepancy.innovations.noise_model import NoiseModel

__all__ = ["UNKNOWN", "Source", "StateFunction", "UnknownLaw"]

#: What a function may act on.
Target = Literal["connection", "input", "state", "output"]
UNKNOWN = "unknown_force"  # the kind of what is found without a law


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where a function may act.

    Parameters
    ----------
    where : str
        Connection, input, state or output.
    acts_on : {"connection", "input", "state", "output"}
    index : int
        Of the source among all that act on the machine, or of the output.
    unit : float
        What moves an output by the noise of its sensor if it lasts.
    """

    where: str
    acts_on: Target
    index: int
    unit: float

    @property
    def in_words(self) -> str:
        """What acts there."""
        return {
            "connection": f"a force at {self.where}",
            "input": f"an addition to the recorded input {self.where}",
            "state": f"an addition to the rate of {self.where}",
            "output": f"an error of the measured output {self.where}",
        }[self.acts_on]


@dataclass(frozen=True, kw_only=True)
class StateFunction:
    """A function of some signals at a source.

    Parameters
    ----------
    source : Source
    signals : tuple of str
        What it depends on, the first of them most.
    size : float
        Its standard deviation, in units of the source.
    """

    source: Source
    signals: tuple[str, ...]
    size: float

    @property
    def in_words(self) -> str:
        """What it is."""
        names = [_in_words(name) for name in self.signals]
        follows = " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
        return f"{self.source.in_words} that is a function of {follows}"

    def to_dict(self) -> dict[str, object]:
        """Return it as it stands in diagnosis.json."""
        return {"where": self.source.where, "acts_on": self.source.acts_on, "depends_on": list(self.signals)}


@dataclass(frozen=True, eq=False, kw_only=True)
class UnknownLaw:
    """What is known of something that follows the machine's state by an unknown law.

    Parameters
    ----------
    functions : tuple of StateFunction
        One, or two where one law acts at two places, as a force constant that depends on the place does.
    gain : float, nats
        By which the log evidence rises: the size of a function, which is maximised over, has paid as a latent process
        does, and the prior odds are those of one effect more for each, all sources being equally probable.
    log_odds : float
        What of that is prior odds.
    share : mapping of str to float
        Of the mean square error of every output, what the functions change.
    samples : int
        Recorded ones of all outputs in the likelihood, which may be computed of means over several.
    predictive : PredictiveGain
        By how much blocks of the records that were left out are predicted better with it.
    noise : NoiseModel, optional
        The noise that was fitted with it.
    """

    functions: tuple[StateFunction, ...]
    gain: float
    log_odds: float
    share: dict[str, float]
    samples: int
    predictive: PredictiveGain
    noise: NoiseModel | None = None

    @property
    def name(self) -> str:
        """``unknown_force@where``, as other effects are named."""
        return f"{UNKNOWN}@{self.functions[0].source.where}"

    @property
    def matters(self) -> bool:
        """Whether it changes some output, or the prediction of all, by a share of the error that one could see."""
        of_prediction = 2.0 * (self.gain - self.log_odds) / max(self.samples, 1)
        return max(*self.share.values(), of_prediction) >= POLICY.unnamed_relevance

    @property
    def predicts(self) -> bool:
        """Whether it matters, and records that were left out are predicted better with it."""
        return self.matters and self.predictive.exceeds(POLICY.predictive_errors)

    @property
    def announced(self) -> bool:
        """Whether it passes what every effect that is announced must pass."""
        odds = (self.gain - self.log_odds) / POLICY.temperature + self.log_odds
        return self.predicts and odds > 0.0

    @property
    def places(self) -> set[tuple[str, str]]:
        """Where it acts: name of a connection, input or output, and which of these that is."""
        return {(f.source.where, f.source.acts_on) for f in self.functions}

    @property
    def sentence(self) -> str:
        """What it says."""
        what = ", and as ".join(f.in_words for f in self.functions)
        output, share = max(self.share.items(), key=lambda t: t[1])
        share_of = f"{100.0 * min(share, 1.0):.0f} % of the mean square error of {output}"
        gain = f"{self.predictive.gain:.0f} ± {self.predictive.standard_error:.0f} nats"
        accounts_for = ", and accounts for" if len(self.functions) == 1 else "; together they account for"
        return (
            "Something follows the machine's state by no law of the catalogue. It is best described as "
            f"{what}{accounts_for} {share_of} (log evidence {self.gain:+.0f}; "
            f"blocks of the records that were left out are predicted better by {gain})."
        )

    def to_dict(self) -> dict[str, object]:
        """Return it as it stands in diagnosis.json."""
        first, *others = self.functions
        return {
            **first.to_dict(),
            **({"elsewhere": [f.to_dict() for f in others]} if others else {}),
            "log_evidence": self.gain,
            "share": dict(self.share),
            "predictive_gain": self.predictive.to_dict(),
            "announced": self.announced,
        }


def _in_words(signal: str) -> str:
    """Return a signal in words.

    Examples
    --------
    >>> _in_words("place.bearing.speed")
    'the speed of bearing'
    >>> _in_words("tank.water")
    'tank.water'
    """
    parts = signal.split(".")
    return f"the {parts[-1]} of {'.'.join(parts[1:-1])}" if parts[0] == "place" and len(parts) > 2 else signal
