"""The real recordings are read as they are, and their traps are told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from estimation import Preparation, ReadRules, RecordError, read_record, read_records
from estimation.signals.metrics import noise_floor
from estimation.signals.preparation import smooth_derivative

EMPS = {
    "time": "time_s",
    "columns": {
        "reference.position": "position_ref_m",
        "carriage.position": "position_m",
        "motor.voltage": "motor_voltage_V",
        "motor.force": "motor_force_N",
    },
    "units": {"reference.position": "m", "carriage.position": "m", "motor.voltage": "V", "motor.force": "N"},
}
SCREW = {
    "time": "time_s",
    "columns": {"speed": "motor_speed_rad_per_s", "torque": "motor_torque_Nm"},
    "units": {"speed": "rad/s", "torque": "N*m"},
}
LIFT = {
    "time": "time_s",
    "columns": {"acceleration": "specific_force_z_m_per_s2"},
    "units": {"acceleration": "m/s**2"},
}


def test_emps_is_read_whole_and_without_remark(measured_data: Path):
    files = ["emps/emps_estimation.csv.gz", "emps/emps_validation_pulses.csv.gz"]
    records = read_records([measured_data / each for each in files], **EMPS)
    for record in records:
        assert len(record.time) == 24841
        assert record.rate == pytest.approx(1000.0, rel=1e-9)
        assert record.log == ()
        # The force column is 35.15065 N/V times the voltage (its provenance), printed to seven digits.
        force, voltage = record.signals["motor.force"].values, record.signals["motor.voltage"].values
        np.testing.assert_allclose(force, 35.15065 * voltage, atol=1e-4)


def test_emps_published_friction_comes_out_of_the_prepared_signals(measured_data: Path):
    record = read_record(measured_data / "emps/emps_estimation.csv.gz", **EMPS)
    time, position = record.time, record.signals["carriage.position"].values
    speed, inside = smooth_derivative(time, position, 100.0)
    acceleration, _ = smooth_derivative(time, position, 100.0, order=2)
    columns = np.column_stack([acceleration, speed, np.sign(speed), np.ones_like(time)])[inside]
    prepare = Preparation(decimate=20)
    smooth_force, _ = smooth_derivative(time, record.signals["motor.force"].values, 100.0, order=0)
    t, force = prepare.apply(time[inside], smooth_force[inside])
    _, regressors = prepare.apply(time[inside], columns)
    mass, viscous, coulomb, offset = np.linalg.lstsq(regressors, force, rcond=None)[0]
    # Janot, Gautier, Brunot 2019: 95.1089 kg, 203.5034 N s/m, 20.3935 N, -3.1648 N.  2 % is three standard
    # errors of the least certain, the viscous friction (1.5 N s/m).  The mass depends on the bandwidth of the
    # derivatives: 98.8 kg at 30 Hz, 96.9 kg at 50 Hz, 95.7 kg at 100 Hz; 100 Hz was chosen knowing that.
    assert len(t) > 1000
    assert mass == pytest.approx(95.1089, rel=0.02)
    assert viscous == pytest.approx(203.5034, rel=0.02)
    assert coulomb == pytest.approx(20.3935, rel=0.02)
    assert offset == pytest.approx(-3.1648, rel=0.02)


def test_emps_noise_floor_is_of_the_size_that_the_best_models_leave(measured_data: Path):
    record = read_record(measured_data / "emps/emps_estimation.csv.gz", **EMPS)
    # The best published inverse model leaves 1.7 N, which is noise and whatever is still missing.
    assert 0.5 < noise_floor(record.signals["motor.force"].values).std < 2.5
    assert noise_floor(record.signals["carriage.position"].values).std < 2e-6


def test_lead_screw_must_be_told_its_trips(measured_data: Path):
    path = measured_data / "lead_screw/steady_state_samples.csv.gz"
    with pytest.raises(RecordError, match=r"lines 502, 1002, .* time runs backwards.*trip ="):
        read_records([path], **SCREW)


def test_each_set_point_of_the_lead_screw_keeps_its_interval(measured_data: Path):
    path = measured_data / "lead_screw/steady_state_samples.csv.gz"
    records = read_records([path], **SCREW, rules=ReadRules(trip="setpoint_file"))
    assert len(records) == 32
    assert all(len(each.time) == 500 for each in records)
    rates = {round(1.0 / each.rate, 7) for each in records}
    # Provenance: 12.8 ms and multiples; the file itself starts at 6.4 ms.
    assert {0.0064, 0.0128, 0.0512} <= rates
    assert "different sampling rates" in records[0].warnings[0]
    by_name = {each.name: each for each in records}
    # The map of means that lies beside the samples.
    mean = by_name["steady_state_samples[n200]"].signals["torque"].values.mean()
    assert mean == pytest.approx(-0.00392488, rel=1e-4)


def test_lead_screw_transients(measured_data: Path):
    path = measured_data / "lead_screw/start_stop_transients.csv.gz"
    records = read_records([path], **SCREW, rules=ReadRules(trip="setpoint_file"))
    assert [each.name for each in records] == ["start_stop_transients[200]", "start_stop_transients[50]"]
    assert all(each.rate == pytest.approx(25.0, rel=1e-6) for each in records)


def test_pendulum_two_files_and_segments(measured_data: Path):
    folder = measured_data / "single_pendulum"
    asked = {"time": "time_s", "columns": {"angle": "angle_rad"}, "units": {"angle": "rad"}}
    files = [folder / f"free_swing_{each}.csv.gz" for each in ("large_amplitude", "small_amplitude_tail")]
    large, tail = read_records(files, **asked)
    assert (len(large.time), len(tail.time)) == (55001, 23176)
    # Hanging is pi; the swing starts near 93 degrees and the tail at 3.8 degrees.
    assert np.max(np.abs(large.signals["angle"].values - np.pi)) == pytest.approx(np.radians(93.0), rel=0.02)
    assert np.max(np.abs(tail.signals["angle"].values - np.pi)) == pytest.approx(np.radians(3.8), rel=0.02)
    parts = read_records(files[:1], **asked, rules=ReadRules(trip="segment"))
    assert [len(each.time) for each in parts] == [9167, 9167, 9167, 9167, 9167, 9166]
    assert sum(len(each.time) for each in parts) == len(large.time)
    found = noise_floor(tail.signals["angle"].values)
    # Provenance: encoder step 1.57e-4 rad.
    assert found.quantisation == pytest.approx(1.57e-4, rel=0.01)
    assert found.source == "quantisation"


def test_text_column_of_the_pendulum_is_refused_as_a_number(measured_data: Path):
    path = measured_data / "single_pendulum/free_swing_large_amplitude.csv.gz"
    with pytest.raises(RecordError, match=r"column 'role', lines 2, 3, .*'estimation' is not a number"):
        read_record(path, time="time_s", columns={"angle": "role"})


def test_lift_ride_must_be_told_what_is_allowed(measured_data: Path):
    path = measured_data / "lift_ride/lift_ride.csv"
    with pytest.raises(RecordError, match=r"gaps after lines 89, .* longest 0\.207 s after line 1678"):
        read_records([path], **LIFT)
    with pytest.raises(RecordError, match="irregular sampling"):
        read_records([path], **LIFT, rules=ReadRules(longest_gap=0.3))
    (ride,) = read_records([path], **LIFT, rules=ReadRules(longest_gap=0.3, resample=50.0))
    assert any("interpolated linearly from about 48" in line for line in ride.log)
    parts = read_records([path], **LIFT, rules=ReadRules(gaps="split", resample=50.0, start=4.2, stop=35.2))
    assert max(each.duration for each in parts) > 25.0
    assert all("cut at" in "".join(each.log) for each in parts)


def test_lift_ride_kinematics_come_out(measured_data: Path):
    path = measured_data / "lift_ride/lift_ride.csv"
    (ride,) = read_records([path], **LIFT, rules=ReadRules(longest_gap=0.3, resample=50.0, start=4.2, stop=35.2))
    reading = ride.signals["acceleration"].values
    step = 1.0 / ride.rate
    # Provenance: 10.30 m/s2 at rest, cruise at 4.07 m/s, noise 0.033 to 0.036 m/s2.
    rest = np.median(reading)
    assert rest == pytest.approx(10.30, abs=0.02)
    speed = np.cumsum(reading - rest) * step
    assert np.max(np.abs(speed)) == pytest.approx(4.07, rel=0.05)
    # The interpolation to 50 Hz averages neighbouring samples, which lowers the noise by up to a third.
    assert 0.02 < noise_floor(reading).std < 0.04
