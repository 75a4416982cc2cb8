"""Three ways to fool oneself with the EMPS recordings, in figures: a copied output, the added pulses, a ripple.

VTSDT_DATA=/path/to/data python examples/emps/traps.py
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from discrepancy import Study
from discrepancy.effects.effect import Effect

HERE = Path(__file__).resolve().parent
WORN = ("asymmetric_viscous_friction", {"forward": 10.0, "backward": 10.0}, {"v_s": 1e-3})
RIPPLE = ("angle_harmonic", {"cosine": 0.1, "sine": 0.1}, {"order": 2.0 * np.pi / 2.5e-3})  # rad/m


def rms(values: np.ndarray) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def figures() -> dict[str, float]:
    """Return the figures that this script prints; forces in N, positions in m, on the held-out recording."""
    study = Study.from_file(HERE / "study.toml")
    place = next(p for p in study.stage.system.places if p.name == "guide")
    kind, strengths, shape = WORN
    stage = study.add(Effect.at_place(kind, place, strengths=strengths, shape=shape))
    (fitted,), (held,) = study.problem.identify, study.problem.validate
    found = {
        "position, model": stage.rmse("validate")["carriage.position"],
        "position, copy of the other recording": rms(
            held.record.signals["carriage.position"].values - fitted.record.signals["carriage.position"].values
        ),
        "force, model": stage.rmse("validate")["motor.force"],
        "force, copy of the other recording": rms(
            held.record.signals["motor.force"].values - fitted.record.signals["motor.force"].values
        ),
        "force, model, on the recording used to fit": stage.rmse("identify")["motor.force"],
    }
    pulse = held.record.signals["added.pulse"]
    p, x = stage.p, {"identify": fitted, "validate": held}
    own = stage.validate.fits[0].own if stage.validate is not None else {}
    for name, factor in (("left out", 0.0), ("given twice", 2.0)):
        signals = {**held.record.signals, "added.pulse": replace(pulse, values=factor * pulse.values)}
        wrong = replace(x["validate"], record=replace(held.record, signals=signals))
        start = wrong.start_vector(stage.slim)
        for state, value in own.items():
            start[stage.slim.index("state", state)] = value
        error = wrong.measured - wrong.simulate(stage.slim, p, start)
        found[f"force, pulses {name}"] = rms(error[:, wrong.outputs.index("motor.force")])
    kind, strengths, shape = RIPPLE
    stage = study.add(Effect.at_place(kind, place, strengths=strengths, shape=shape))
    ripple = stage.effects[-1]
    found["ripple, N"] = float(np.hypot(*ripple.strengths.values()))
    found["ripple, wavelength in mm"] = 2e3 * np.pi / ripple.shape["order"]
    found["force with ripple, on the recording used to fit"] = stage.rmse("identify")["motor.force"]
    found["force with ripple"] = stage.rmse("validate")["motor.force"]
    return found


if __name__ == "__main__":
    for name, value in figures().items():
        print(f"{name:50s} {value:.4g}")
