"""Checks of the recordings that a model is updated from, before anything is simulated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gearbox.updating.settings import UpdatingSettings

if TYPE_CHECKING:
    from gearbox.signals.recordings import Recording
    from gearbox.signals.signal import Signal

__all__ = ["recording_faults"]


def recording_faults(
    settings: UpdatingSettings, identify: Sequence[Recording], every: Sequence[Recording]
) -> list[str]:
    """Return one sentence for each fault, naming recording and sensor.

    Parameters
    ----------
    settings : UpdatingSettings
    identify : sequence of Recording
        Those that the model may be updated from.
    every : sequence of Recording
        These and those that are held out.
    """
    faults = [] if identify else ["there is no recording to update the model from"]
    wanted = dict.fromkeys((settings.sensor, *settings.sensors))
    for recording in every:
        missing = [s for s in wanted if s not in recording.signals]
        if missing:
            have = ", ".join(recording.signals)
            faults.append(f"recording '{recording.name}' has no sensor {', '.join(missing)}; it has {have}")
        for sensor in wanted:
            if sensor not in missing:
                faults += _signal_faults(settings, recording.name, recording.signals[sensor], sensor == settings.sensor)
    return faults


def _signal_faults(settings: UpdatingSettings, name: str, signal: Signal, compared: bool) -> list[str]:
    """Faults of one signal; ``compared`` by cosine similarity it must fill the window and hold the band."""
    where, process = f"recording '{name}', sensor '{signal.name}'", settings.processing
    if np.ptp(signal.values) <= 1e-12 * max(float(np.abs(signal.values).max()), 1e-300):
        return [f"{where}: the signal does not vary (zero variance): check the sensor and its column"]
    faults = []
    if compared and process.band[1] >= signal.nyquist:
        faults.append(
            f"{where}: sampled at {signal.rate:g} Hz it holds nothing above {signal.nyquist:g} Hz, its Nyquist "
            f"frequency; the band goes up to {process.band[1]:g} Hz: take a lower band or record faster"
        )
    if compared and process.needed > signal.duration + 0.5 / signal.rate:
        faults.append(
            f"{where}: it lasts {signal.duration:.4g} s; a window of {process.duration:g} s and what the filter needs "
            f"at both ends take {process.needed:.4g} s: record longer, or take a shorter window (duration)"
        )
    return faults
