"""Faulty recordings of trips: each fault is named; good ones are prepared alike."""

from __future__ import annotations

import json

import numpy as np
import pytest

from vtsdt.alignment.estimate import align, balance
from vtsdt.alignment.rail import rail_profile
from vtsdt.alignment.sections import Section, sections
from vtsdt.alignment.trips import AlignmentError, find_columns, read_trips
from vtsdt.alignment.view import alignment_view
from vtsdt.cli.command_line import main
from vtsdt.files.parameters import LiftParameters

STEP = 2e-3


def signals(direction: int = 1, friction: float = 7.0, offset: float = 0.0, seed: int = 5):
    """A trip without vibration: weight, inertia, friction against the way, sensors with little noise."""
    from multibody.library.profiles import jerk_limited

    time = np.arange(3000) * STEP
    moved = np.array([jerk_limited(t - 0.15, 1.9 * direction, 0.42, 0.45, 1.5)[:3] for t in time])
    rng = np.random.default_rng(seed)
    height = moved[:, 0] + (0.0 if direction > 0 else 1.9)
    tension = 32.0 * (9.80665 + moved[:, 2]) + friction * np.tanh(moved[:, 1] / 0.01) + offset
    return {
        "time_s": time,
        "tension_c_N": tension + 0.1 * rng.standard_normal(time.size),
        "cabin_height_mm": 1e3 * height + 0.01 * rng.standard_normal(time.size),
        "cabin_acceleration_m_per_s2": moved[:, 2] + 0.01 * rng.standard_normal(time.size),
    }


def write(path, columns):
    """Write columns as CSV and return the path."""
    text = ",".join(columns) + "\n"
    text += "\n".join(",".join(f"{v:.9g}" for v in row) for row in zip(*columns.values(), strict=True))
    path.write_text(text)
    return path


def refused(tmp_path, columns, **options) -> str:
    """Return the message with which a trip is refused."""
    from estimation.files.faults import RecordError

    with pytest.raises((AlignmentError, RecordError)) as error:
        read_trips([write(tmp_path / "trip.csv", columns)], **options)
    return str(error.value)


def test_a_good_trip_is_prepared(tmp_path):
    columns = signals()
    columns["cabin_acceleration_m_per_s2"] += 0.05
    (trip,) = read_trips([write(tmp_path / "trip.csv", columns)])
    assert trip.direction == 1
    assert trip.offset == pytest.approx(0.05, abs=2e-3)
    assert trip.acceleration.mean() == pytest.approx(0.0, abs=2e-3)
    assert trip.height[-1] == pytest.approx(1.9, abs=1e-3)
    assert np.std(np.diff(trip.tension)) < 0.6 * np.std(np.diff(columns["tension_c_N"]))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c | {"cabin_height_mm": 900.0 + 0.0 * c["time_s"] + 0.01 * np.sin(c["time_s"])}, "never moves"),
        (
            lambda c: {
                ("tension_c" if k == "tension_c_N" else k): v / (9.80665 if k == "tension_c_N" else 1.0)
                for k, v in c.items()
            },
            "look like kg; give --tension-unit kgf",
        ),
        (lambda c: c | {"tension_c_N": 1e-3 * c["tension_c_N"]}, "look like kN"),
        (lambda c: c | {"tension_c_N": -c["tension_c_N"]}, "its sign is reversed"),
        (lambda c: c | {"tension_c_N": 0.6 * c["tension_c_N"]}, "check its unit and zero"),
        (
            lambda c: c | {"cabin_acceleration_m_per_s2": np.clip(c["cabin_acceleration_m_per_s2"] * 3, -0.4, 0.4) / 3},
            "acceleration is clipped",
        ),
        (lambda c: c | {"cabin_acceleration_m_per_s2": -c["cabin_acceleration_m_per_s2"]}, "have opposite signs"),
        (lambda c: c | {"cabin_height_mm": 1900.0 - c["cabin_height_mm"]}, "the height of the cabin and not of the c"),
        (lambda c: c | {"cabin_acceleration_m_per_s2": c["cabin_acceleration_m_per_s2"] / 9.80665}, "looks like g"),
        (lambda c: c | {"cabin_acceleration_m_per_s2": c["cabin_acceleration_m_per_s2"] + 9.81}, "contains gravity"),
        (lambda c: c | {"cabin_acceleration_m_per_s2": np.roll(c["cabin_acceleration_m_per_s2"], 900)}, "do not match"),
        (lambda c: c | {"cabin_height_mm": 1e3 * c["cabin_height_mm"]}, "the cabin travels 1900 m"),
        (lambda c: c | {"time_s": np.where(np.arange(3000) > 1500, c["time_s"] + 0.7, c["time_s"])}, "gap"),
        (
            lambda c: c | {"time_s": np.where(np.arange(3000) > 1500, c["time_s"] - 0.7, c["time_s"])},
            "time runs backwards",
        ),
        (lambda c: {k: v[::20] for k, v in c.items()}, "sampled at 25 Hz"),
    ],
)
def test_each_fault_of_a_recording_is_named(tmp_path, change, message):
    assert message in refused(tmp_path, change(signals()))


def test_swapped_sensors_are_reported_with_the_remedy(tmp_path):
    c = signals()
    plain = {
        "time_s": c["time_s"],
        "tension": c["cabin_height_mm"] / 1e3,
        "height": c["tension_c_N"],
        "acceleration": c["cabin_acceleration_m_per_s2"],
    }
    message = refused(tmp_path, plain)
    assert "look swapped" in message
    assert "--tension height --height tension" in message
    plain = {
        "time_s": c["time_s"],
        "tension": c["cabin_acceleration_m_per_s2"],
        "height": c["cabin_height_mm"] / 1e3,
        "acceleration": c["tension_c_N"],
    }
    assert "the tension (column 'tension') and the acceleration (column 'acceleration') look swapped" in refused(
        tmp_path, plain
    )


def test_units_that_the_user_says_are_taken(tmp_path):
    c = signals()
    c["tension"] = c.pop("tension_c_N") / 9.80665
    (trip,) = read_trips([write(tmp_path / "trip.csv", c)], units={"tension": "kgf"})
    assert np.median(trip.tension) == pytest.approx(32.0 * 9.80665, rel=0.03)


def test_columns_are_found_by_their_names_or_asked_for(tmp_path):
    c = signals()
    renamed = dict(zip(("t [s]", "F_c [N]", "z_c [mm]", "acc [m/s2]"), c.values(), strict=True))
    path = write(tmp_path / "trip.csv", renamed)
    with pytest.raises(AlignmentError, match=r"no column looks like the acceleration .* --acceleration COLUMN"):
        find_columns(path)
    columns = find_columns(path, {"acceleration": "acc [m/s2]"})
    assert columns == {"time": "t [s]", "tension": "F_c [N]", "height": "z_c [mm]", "acceleration": "acc [m/s2]"}


def test_balance_finds_what_is_no_friction(tmp_path):
    ways = enumerate((1, -1, 1, -1))
    paths = [write(tmp_path / f"{k}.csv", signals(direction, 7.0, 2.5, seed=k)) for k, direction in ways]
    trips = read_trips(paths)
    height = np.linspace(0.1, 1.8, 50)
    assert balance(trips, LiftParameters.bench(), height) == pytest.approx(2.5, abs=0.05)
    assert balance(trips[::2], LiftParameters.bench(), height) is None


def test_one_trip_named_twice_is_refused(tmp_path):
    trip = signals(1, seed=1)
    paths = [write(tmp_path / "t0.csv", trip), write(tmp_path / "again.csv", {k: v[500:2500] for k, v in trip.items()})]
    for twice in ([paths[0], paths[0]], paths):
        with pytest.raises(
            AlignmentError, match=r"holds what t0.csv holds \(\d+ rows\), so that one trip would count twice"
        ):
            read_trips(twice)


def test_sections_join_and_leave_out():
    h = np.linspace(0.0, 2.0, 201)
    delta = np.full(h.size, 1e-3)
    delta[20:41] = 3e-3
    delta[30] = 1e-3  # a gap of 20 mm
    delta[100] = 3e-3  # a single height
    delta[150:161] = 3e-3
    assert [(round(a, 2), round(b, 2)) for a, b in sections(h, delta, 2.3e-3)] == [(0.2, 0.4), (1.5, 1.6)]
    assert str(Section(low=0.2, high=0.4, largest=3e-3, at=0.3)) == "0.20 to 0.40 m (up to 3.00 mm at 0.30 m)"


def test_rail_has_the_equivalent_deviation_and_says_what_is_unknown():
    """A wave of twice the distance of the shoes shows nowhere; a slow one comes back."""
    shoes, h = (0.03, 0.55), np.linspace(0.0, 1.9, 191)
    slow = lambda x: 2e-3 + 0.4e-3 * np.cos(2 * np.pi * x / 2.5)  # noqa: E731
    q = 0.5 * (slow(h + 0.03) + slow(h + 0.55))
    at, delta, std = rail_profile(h, q, np.full(h.size, 1e-5), shoes)
    back = 0.5 * (np.interp(h + 0.03, at, delta) + np.interp(h + 0.55, at, delta))
    assert np.abs(back - q).max() < 0.03e-3
    assert np.abs(delta - slow(at)).max() < 0.3e-3
    assert np.mean(np.abs(delta - slow(at)) < 2 * std) > 0.9
    hidden = 2e-3 + 0.4e-3 * np.cos(2 * np.pi * (h + 0.03) / 1.04)
    q = 0.5 * (hidden + 2e-3 + 0.4e-3 * np.cos(2 * np.pi * (h + 0.55) / 1.04))
    assert np.ptp(q) < 1e-9


def test_command_writes_page_json_rail_and_figures(tmp_path, capsys):
    paths = [str(write(tmp_path / f"{k}.csv", signals(d, 7.0, seed=k))) for k, d in enumerate((1, -1))]
    out = tmp_path / "out"
    assert main(["align", *paths, "--out", str(out), "--threshold", "2.0"]) == 0
    message = capsys.readouterr().out
    assert "vtsdt what-if" in message
    assert {p.name for p in out.iterdir()} == {
        "alignment.json",
        "report.html",
        "profile.csv",
        "alignment.png",
        "rail.png",
        "trips.png",
        "run.json",
    }
    content = json.loads((out / "alignment.json").read_text())
    assert len(content["height_m"]) == len(content["median_mm"]) == len(content["trips"][0]["delta_mm"])
    assert content["observability"]["detectable"]
    assert (out / "profile.csv").read_text().startswith("height_m,delta_mm,spread_mm\n")
    page = (out / "report.html").read_text()
    assert "http://" not in page
    assert "https://" not in page
    view = alignment_view(out)
    shown = view({})
    (figure,) = shown["figures"]
    assert [round(a, 4) for band in figure["bands"] for a in band] == [
        s[k] for s in content["sections"] for k in ("from_m", "to_m")
    ]
    assert len(figure["lines"]) == 2 + 4  # trips; estimate, its limits, threshold
    assert view({"threshold": 50.0})["figures"][0]["bands"] == []
    assert "vtsdt what-if" in shown["sentences"][-1]
    interval = {"value": 10.0, "low": 8.0, "high": 12.0}
    section = {"low_m": 1.0, "high_m": 2.0, "deviation_mm": 3.0, "saving_J": interval}
    actions = {"straightened": {"saving": interval, "gain": {"value": 0.01, "low": None, "high": None}}}
    profile = {"height_m": [0.5, 1.0, 2.0], "delta_mm": [1.0, 3.0, 2.0], "spread_mm": [0.1, 0.1, 0.1]}
    saved = {"threshold_mm": 2.0, "sections": [section], "actions": actions, "profile": profile}
    (out / "what-if.json").write_text(json.dumps(saved), encoding="utf-8")
    shown = alignment_view(out)({"threshold": 1.0})
    rail = shown["figures"][1]  # its heights are not those of the cabin
    assert rail["labels"][0] == "height on the rail [m]"
    assert rail["bands"] == [[1.0, 2.0]]
    assert (rail["lines"][0]["x"], rail["lines"][0]["y"]) == (profile["height_m"], profile["delta_mm"])
    tables = {t["title"]: t["rows"] for t in shown["tables"]}
    assert tables["What each action would save, with 95 % intervals"] == [["straightened", "10 (8 to 12)", "1"]]
    assert tables["What straightening one section alone would save"] == [["1.00 to 2.00 m", "3.00 mm", "10 (8 to 12)"]]
    (out / "what-if.json").write_text("{}", encoding="utf-8")
    with pytest.raises(ValueError, match="the entry 'threshold_mm' is missing"):
        alignment_view(out)
    assert main(["open", "--lift", str(tmp_path)]) == 2
    assert "there is no alignment.json in this folder: run vtsdt align" in capsys.readouterr().err


def test_command_refuses_in_one_message_without_a_traceback(tmp_path, capsys):
    still = signals() | {"cabin_height_mm": 900.0 + 0.01 * np.sin(signals()["time_s"])}
    a, b = write(tmp_path / "still.csv", still), write(tmp_path / "kg.csv", signals())
    text = b.read_text().replace("tension_c_N", "tension_c")
    b.write_text(text)
    c = signals()
    c["tension_c_N"] /= 9.80665
    write(b, c)
    assert main(["align", str(a), str(b), "--out", str(tmp_path / "out")]) == 2
    message = capsys.readouterr().err
    assert "still: the cabin never moves" in message
    assert "kg: the tension" in message
    assert "Traceback" not in message
    assert main(["align", str(a), "--tuning", "best", "--out", str(tmp_path)]) == 2
    assert main(["align", str(tmp_path / "none.csv"), "--out", str(tmp_path)]) == 2


def test_a_tension_that_cannot_be_friction_makes_the_filter_diverge(tmp_path):
    up = read_trips([write(tmp_path / "up.csv", signals(1, 7.0, 33.0))])
    with pytest.raises(AlignmentError, match=r"diverges.*check the tension's zero"):
        align(up, observe=False)
    low = read_trips([write(tmp_path / "low.csv", signals(1, 7.0, -12.0))])
    with pytest.raises(AlignmentError, match=r"less friction than.*check the tension's zero"):
        align(low, observe=False)
