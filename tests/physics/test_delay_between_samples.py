"""Delays that are no whole number of samples, against sums of sines that are known in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from estimation import Experiment, Record, RecordedSignal, SensorError, UncertainParameter, calibrate
from estimation.response.sensors import apply_sensors
from multibody import Model
from multibody.library import Damper, ForceSource, Mass, Measurement

TIME = np.arange(1000) * 0.01  # s: 100 Hz
MASS, DAMPING = 2.0, 5.0
DELAYS = (0.003, 0.0124, 0.0377)  # s
SINES = {"2 Hz": (2.0,), "a tenth of the rate": (10.0,), "several": (1.0, 3.0, 7.0, 13.0)}  # Hz
NEAR = 3e-5  # s; straight lines between samples are up to 4.4e-5 s off at the highest of these


def sines(frequencies, delay, response=np.ones_like):
    """A sum of sines that is late, behind a linear machine."""
    omega = 2.0 * np.pi * np.array(frequencies)
    phase = omega * (TIME[:, None] - delay) + 0.7 * np.arange(omega.size)
    return np.imag(np.exp(1j * phase) @ response(omega))


def read_late(values, delay, derivatives=()):
    """Values, shape (nt,), behind a late sensor, and their derivative by its delay."""
    y, _, by = apply_sensors(
        ["y"], TIME, values[:, None], np.zeros((TIME.size, 1, 0)), [SensorError("y", "delay", delay)], derivatives
    )
    return y[:, 0], {name: values[:, 0] for name, values in by.items()}


@pytest.mark.parametrize("frequencies", SINES.values(), ids=SINES)
@pytest.mark.parametrize("delay", DELAYS)
def test_a_sensor_delay_is_found_between_samples(frequencies, delay):
    seen, true = sines(frequencies, delay), sines(frequencies, 0.0)
    begun = TIME > 0.1  # before the record's begin the signal is not known
    found = least_squares(
        lambda x: (read_late(true, x[0])[0] - seen)[begun], [delay + 2e-3], x_scale=1e-3, xtol=1e-12
    ).x[0]
    assert abs(found - delay) < NEAR


@pytest.mark.parametrize("delay", [0.0, *DELAYS])
def test_derivative_by_a_sensor_delay(delay):
    true, step = sines(SINES["several"], 0.0), 1e-6
    by_delay = read_late(true, delay, ["sensor.y.delay"])[1]["sensor.y.delay"]
    late, early = (read_late(true, delay + d)[0] for d in (step, -step))
    begun = (TIME > 0.1) & (TIME < 9.9)
    # Of central differences the truncation is step² of the third derivative, 1e-7 of the largest rate.
    expected = (late - early)[begun] / (2.0 * step)
    np.testing.assert_allclose(by_delay[begun], expected, atol=1e-6 * np.max(np.abs(expected)))


def test_what_is_late_is_late_in_its_derivatives_too():
    true, other = sines((2.0,), 0.0), sines((3.0,), 0.0)
    dy = np.stack([true, other], axis=1)[:, None, :]
    late = apply_sensors(["y"], TIME, true[:, None], dy, [SensorError("y", "delay", 0.0124)], [])
    np.testing.assert_allclose(late[1][:, 0, 0], late[0][:, 0], atol=1e-12)
    np.testing.assert_allclose(late[1][:, 0, 1], read_late(other, 0.0124)[0], atol=1e-12)


def test_a_virtual_sensor_is_late_by_its_delay():
    inner = (TIME > 0.1) & (TIME < 9.9)  # at the ends a spline knows one side only
    read = Measurement(delay=0.0124).apply(TIME, sines((10.0,), 0.0), rng=0)
    # The spline's error at ten samples a period: h⁴ω⁴/384 = 4e-4 of the amplitude.
    np.testing.assert_allclose(read[inner], sines((10.0,), 0.0124)[inner], atol=5e-4)


@pytest.mark.parametrize("delay", DELAYS)
def test_an_input_delay_is_found_between_samples(delay):
    """Inputs stay straight between samples: the machine without a delay has to be the machine with one of zero."""
    model = Model("damped mass")
    body, oil, drive = (
        model.add(name, part)
        for name, part in {"body": Mass(m=MASS), "oil": Damper(damping=DAMPING), "drive": ForceSource()}.items()
    )
    model.connect(body.flange, oil.a, drive.flange)
    model.connect(oil.b, model.ground)
    model.input("force", drive.force)
    frequencies = (2.0,)
    speed = sines(frequencies, delay, lambda omega: 1.0 / (1j * omega * MASS + DAMPING))
    signals = {
        "force": RecordedSignal(values=sines(frequencies, 0.0), unit="N", column="force", measured_unit="N"),
        "body.velocity": RecordedSignal(values=speed, unit="m/s", column="speed", measured_unit="m/s"),
    }
    experiment = Experiment(
        record=Record(name="sines", path=Path("sines.csv"), time=TIME, signals=signals),
        inputs=("force",),
        outputs=("body.velocity",),
        free=("body.velocity",),
        rtol=1e-9,
    )
    unknown = UncertainParameter(name="input.force.delay", value=0.02, std=0.05, min=0.0, unit="s")
    system = model.with_input_error("force", delay=0.02).build()
    fit = calibrate(system, [experiment], [unknown], noise={"body.velocity": 1e-6})
    assert abs(fit["input.force.delay"] - delay) < NEAR
