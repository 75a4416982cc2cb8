"""A what-if study from its settings: read profile and trips, simulate the actions, write the page."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from estimation.signals.preparation import low_pass
from multibody.base.progress import Progress, silent
from multibody.base.result_folder import check_owner
from vtsdt.files.parameters import LiftParameters, ParameterError
from vtsdt.files.rail_profile_table import ProfileTable
from vtsdt.whatif.compare import (
    FRICTION_LOW_PASS,
    compare_trips,
    read_measured_trips,
    with_measured_masses,
    with_rail,
)
from vtsdt.whatif.report import OWNER, write_what_if
from vtsdt.whatif.result import WhatIf
from vtsdt.whatif.settings import Settings
from vtsdt.whatif.study import what_if
from vtsdt.whatif.threshold import Threshold, configuration_of, friction_loss, threshold_of

__all__ = ["run_what_if"]


def run_what_if(settings: Settings, out: str | Path, progress: Progress = silent) -> tuple[WhatIf, Path]:
    """Carry out a what-if study and write it into a folder.

    Parameters
    ----------
    settings : Settings
    out : path
    progress : callable, optional

    Returns
    -------
    WhatIf, Path
        The study, and its page.

    Raises
    ------
    ParameterError, RecordError, ValueError
        With every fault of files and settings.
    """
    from vtsdt.whatif.compare import with_measured_masses

    parameters = LiftParameters.load(settings.lift) if settings.lift else LiftParameters.bench()
    check_owner(Path(out), OWNER, parameters.name)
    rail = ProfileTable.load(settings.profile) if settings.profile else None
    if rail is None:
        if parameters.cabin_guide.right_x is None:
            raise ParameterError(
                "what-if", ["the lift's right rail is straight: give --profile, as `vtsdt align` writes it"]
            )
        rail = ProfileTable.of(parameters.cabin_guide.right_x)
    notes = []
    low, high = float(rail.height[0]), float(rail.height[-1])
    reach = parameters.hoistway.travel + parameters.cabin.shoe_high
    if high < reach - 0.05 or low > parameters.cabin.shoe_low + 0.05:
        notes.append(
            f"The profile covers {low:.2f} to {high:.2f} m, the shoes reach {parameters.cabin.shoe_low:.2f} to "
            f"{reach:.2f} m: beyond its ends the rail is assumed to keep the deviation of its ends."
        )
    rail = _extended(rail, parameters)
    records = read_measured_trips(settings.trips, settings.time, settings.columns) if settings.trips else []
    if records:
        parameters = with_measured_masses(parameters, records)
    parameters = with_rail(parameters, rail)
    threshold = threshold_from(settings, parameters) if settings.configurations else None
    trips = compare_trips(records, parameters, rail, progress=progress) if records else []
    study = what_if(
        parameters,
        rail,
        threshold=threshold.level if threshold is not None else settings.threshold,
        lubrication=settings.lubrication,
        uncertainties=settings.uncertainties,
        samples=settings.samples,
        direction=settings.direction,
        seed=settings.seed,
        progress=progress,
    )
    progress("draw the figures")
    page = write_what_if(
        Path(out), study, settings, lift=parameters.name, trips=trips, threshold=threshold, notes=notes
    )
    return study, page


def _extended(rail: ProfileTable, parameters: LiftParameters) -> ProfileTable:
    """Return the profile over the whole rail, constant beyond its ends as in the model."""
    low, high = parameters.hoistway.rail_bottom, parameters.hoistway.rail_top
    height, delta, spread = rail.height, rail.delta, rail.spread
    if height[0] > low:
        height, delta, spread = np.r_[low, height], np.r_[delta[0], delta], np.r_[spread[0], spread]
    if height[-1] < high:
        height, delta, spread = np.r_[height, high], np.r_[delta, delta[-1]], np.r_[spread, spread[-1]]
    return ProfileTable(height, delta, spread)


def threshold_from(settings: Settings, parameters: LiftParameters) -> Threshold:
    """Return the threshold from the configurations of the settings: estimated profiles, measured energies.

    The energy of a trip is ∫ friction · speed with friction = m (z̈ + g) − F_c, the cabin's mass from the tension at
    rest of all trips of that configuration.
    """
    configurations = []
    for files in settings.configurations:
        records = read_measured_trips(files.trips, settings.time, settings.columns)
        cabin = with_measured_masses(parameters, records).cabin
        energies = []
        for record in records:
            t = np.asarray(record.time)
            signal = {n: np.asarray(s.values) for n, s in record.signals.items()}
            speed = np.gradient(low_pass(t, signal["z_c"], FRICTION_LOW_PASS), t)
            mass = cabin.mass + float(np.median(signal["payload"]))
            energies.append(friction_loss(t, signal["F_c"], signal["a_c"], speed, mass))
        reach = parameters.hoistway.travel + parameters.cabin.shoe_high
        rail = ProfileTable.load(files.profile)
        low, high = max(rail.height[0], parameters.cabin.shoe_low), min(rail.height[-1], reach)
        configurations.append(configuration_of(files.name, rail, energies, float(low), float(high)))
    return threshold_of(configurations, settings.fraction, seed=settings.seed)
