"""Every number that a search chooses, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass

from discrepancy.statistics.thresholds import HARMFUL_SHARE, RELEVANT_SHARE, SHOWN_GROWTH, SIMULATION_ERRORS

__all__ = ["POLICY"]


@dataclass(frozen=True, kw_only=True)
class Policy:
    """The numbers of a search.

    Parameters
    ----------
    beam : int
        Models that may be extended or taken at a time.
    reach : float
        Nats below the best model up to which the noise of another is made as rich as that of the best, and up to which
        two log evidences of one model may differ by where it is linearised.  No effect costs more, so a model that lies
        further below a simpler one was fitted in the wrong place.
    expansions : int
        Models that are extended, at most: bounds the time of a search.
    refits : int
        Candidates of a step that are fitted in full, best linear evidence first: each costs a second or more.
    same_direction : float
        Correlation of what two candidates change, from which a full fit of both would tell nothing more.
    linear_error : float
        Share of a gain by which the linear evidence may be off: rivals within it are tried.  A guess.
    rivals : int
        Other explanations of one effect that are tried in its place.
    pairs : int
        Pairs of a step that are fitted in full.
    effect_cost : float
        Nats that an effect of a pair pays for its strength and shape in the linear evidence, where each is taken at the
        shape that fits it best by itself: about what the prior of one strength and a short shape grid cost.
    pair_advantage : float
        Nats by which the linear evidence of a pair must exceed that of the best single effect to be fitted at once.
    improvement : float
        Nats by which a model must be better than the one that it was made of to be extended, and within which two
        models are as good as each other.  The prior odds are part of the evidence, so zero would do were the evidence
        exact; the Laplace approximation is not, by about one nat for each of the few parameters that an effect has.
    likeliest_steps : int
        Steps to the likeliest parameters, each linearised anew: where dry friction sticks, the evidence wanders after
        the first, and how much is seen from two more.  At most as many are made to the likeliest shapes of laws;
        chosen.
    relevance : float
        Share of a mean square error, a hundredth of the error itself, from which a change of it counts: nobody would
        see less in a figure.  An effect that changes so much of an output must lower it on the records left out.
    unnamed_relevance : float
        Share of the mean square error of some output, or of the predictions from sample to sample, that what has no
        name must account for: a fifth of the error itself.  No law can be added to the model for it, and much leaves a
        little: how a drive moves between two samples, another solver, the steps of a converter.
    harm : float
        Share by which the mean square error of no output may grow, in the same sense.
    simulation_errors : float
        Standard errors, over the records, that such a share must exceed.
    growth : float
        Share by which it may grow on all records held out together, by chance or not, unless the model is certain.
    growth_by_chance : float
        Share by which it may grow, over calibration or a simpler model, where the model is certain and the growth may
        be chance: a tenth of the error itself.  Nobody believes an effect with which a simulation is visibly worse,
        whatever the evidence; chosen.
    certain_errors : float
        Standard errors by which the log predictive score of the records held out must rise for that: what is asked of a
        discovery in physics.
    naming_errors : float
        Standard errors, of a normal distribution, by which the log predictive score of blocks left out must rise with
        an effect that is named: a level of 5 %, which is how many names that are not there a user should meet.
    predictive_errors : float
        Standard errors by which it must rise where less is claimed: of the records held out with an effect that the
        others show, or of blocks left out with what has no name, or with a law in the place of a simpler one.
    temperature : float
        Divisor of log evidence in the probabilities that are shown, once what is overstated was left out of it.  Chosen
        before any case was judged.  Cases on machines of plain equations ask for 1.2 (seeds 85 and 86), 2.6 (87) and
        4.9 (88); with 1.5 a second effect that is not there was named on the virtual axis (docs/method/evidence.md).
    unseen : float
        Share of the effects outside the catalogue of which the search says nothing: 51 of 153 of those of 100 and 1000
        nats on the machines of plain equations, seeds 76 to 81 (docs/method/machines-history.md).
    set_share, listed : float
        Probability that an effect and the alternatives listed beside it reach together, and the least of one of them.
    tie : float
        Odds against the best explanation down to which another counts as indistinguishable: one to twenty.
    """

    beam: int = 5
    reach: float = 12.0
    expansions: int = 6
    refits: int = 4
    same_direction: float = 0.995
    linear_error: float = 0.3
    rivals: int = 4
    pairs: int = 2
    effect_cost: float = 3.0
    pair_advantage: float = 5.0
    improvement: float = 3.0
    likeliest_steps: int = 3
    relevance: float = RELEVANT_SHARE
    unnamed_relevance: float = 0.05
    harm: float = HARMFUL_SHARE
    simulation_errors: float = SIMULATION_ERRORS
    growth: float = SHOWN_GROWTH
    growth_by_chance: float = 0.2
    certain_errors: float = 5.0
    naming_errors: float = 1.645
    predictive_errors: float = 1.0
    temperature: float = 3.0
    unseen: float = 51 / 153
    set_share: float = 0.95
    listed: float = 0.01
    tie: float = 0.05

    def error_of_gain(self, gain: float) -> float:
        """Return by how many nats a gain of the linear evidence may be off.

        Examples
        --------
        >>> POLICY.error_of_gain(10.0), POLICY.error_of_gain(100.0)
        (12.0, 30.0)
        """
        return max(self.reach, self.linear_error * gain)


POLICY = Policy()
