"""Every number that the search by significance chooses, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["POLICY"]


@dataclass(frozen=True, kw_only=True)
class Policy:
    """The numbers of a search by significance; those that it shares are `discrepancy.statistics.thresholds`.

    Parameters
    ----------
    finalists : int
        Candidates of a step that are fitted in full, of those that differ in what they change: each costs a second or
        more.
    finalist_reduction : float
        Share of the best candidate's expected error reduction, or of the best pair's gain, from which another is fitted
        as well.
    same_correlation : float
        Correlation of what two candidates change from which a fit of the second would show nothing new.
    well_explained : float
        Share of the mean square error that the best fit must remove, or else the laws at its place that are not linear
        in their strength are fitted too: a linear scan misjudges them.
    simpler_reduction : float
        Share of a richer law's error reduction with which the simpler law in it is the first answer: no law is exact,
        and one with more freedom always fits a little better.
    presence : float
        Standard deviations of the full fit from which a strength is known to be different from zero: about 95 %.
    unfitted_tie_correlation : float
        Correlation of what two effects change from which the scan alone, without a fit of the second, can call them a
        tie.
    twin_tie : float
        Multiple of the decisive difference of BIC within which two effects that change the same are a tie: fits on
        trial of almost the same model end a few points of BIC apart.
    listed : int
        Best candidates of the scan that are listed as other explanations though they were not fitted.
    pairs : int
        Masking pairs of a step that are fitted in full, of those that differ in what they change.
    likely_reduction : float
        Share of the mean square error, on average over the outputs, that an effect without significance must remove.
    exchange_delta_bic : float
        Difference of BIC up to which another explanation of an effect is tried again in its place: it was found while
        the other effects were still in the residual.
    exchange_correlation : float
        Correlation of what they change from which the same law at another place is tried in the place of an effect.
    exchanges : int
        Other explanations of one effect that are tried in its place.
    linear_error : float
        Most that a fit of a free curve gains, as a multiple of its linear prediction: up to 2.8 seen
        (docs/method/which-law.md).
    curve_reduction : float
        Share of the excess error that a free curve must remove beyond the law that it replaces.
    curves : int
        Free curves of an offer that are fitted in full, the best first.
    repeats : float
        Periods within the motion from which a wave is seen to repeat.
    wave_reduction : float
        Share of what several waves remove that a curve in their place must remove.
    above_noise : float
        Multiple of the noise floor above which a residual needs an explanation; chosen, not measured.
    noise_share : float
        Share of the noise floor that is added to every error before two are compared: an error far below the noise
        counts for nothing, whatever its logarithm.
    start_shares : tuple of float
        Of the strengths given, at which the fit of an effect added by hand begins, one after another until the machine
        can be simulated.
    wider_prior : float
        Factor on the stated standard deviations of the parameters where they are to explain what an effect explains:
        hardly any prior is left.
    """

    finalists: int = 3
    finalist_reduction: float = 0.5
    same_correlation: float = 0.9999
    well_explained: float = 0.8
    simpler_reduction: float = 0.8
    presence: float = 2.0
    unfitted_tie_correlation: float = 0.98
    twin_tie: float = 2.0
    listed: int = 8
    pairs: int = 5
    likely_reduction: float = 0.25
    exchange_delta_bic: float = 30.0
    exchange_correlation: float = 0.9
    exchanges: int = 4
    linear_error: float = 3.0
    curve_reduction: float = 0.03
    curves: int = 2
    repeats: float = 2.0
    wave_reduction: float = 0.9
    above_noise: float = 2.0
    noise_share: float = 1e-3
    start_shares: tuple[float, ...] = (1.0, 0.3, 0.1, 0.01)
    wider_prior: float = 1000.0


POLICY = Policy()
