"""What-if studies: profile tables, thresholds, settings, and the page; energies stand in tests/papers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from multibody.base.parameter_file import ParameterError
from vtsdt.files.parameters import LiftParameters
from vtsdt.files.rail_profile import RailProfile
from vtsdt.files.rail_profile_table import ProfileTable
from vtsdt.lift.energy import TripEnergy
from vtsdt.whatif.compare import with_measured_masses
from vtsdt.whatif.report import summary, write_what_if
from vtsdt.whatif.result import Action, Interval, SectionSaving, WhatIf
from vtsdt.whatif.settings import Settings, read_settings
from vtsdt.whatif.study import Uncertainty, _cut, _rail_error, uncertainties_from, what_if
from vtsdt.whatif.threshold import Configuration, configuration_of, friction_loss, threshold_of

BENCH = ProfileTable.of(LiftParameters.bench().cabin_guide.right_x)  # type: ignore[arg-type]


# -------------------------------------------------------------------- profile tables


@pytest.mark.parametrize("name", ["profile.csv", "profile.json"])
def test_a_profile_goes_through_a_file_and_back(name: str, tmp_path: Path) -> None:
    table = ProfileTable(np.array([0.0, 0.5, 1.0]), np.array([1e-3, 2e-3, -1e-3]), np.array([1e-4, 0.0, 2e-4]))
    table.save(tmp_path / name)
    back = ProfileTable.load(tmp_path / name)
    for a, b in zip(table._columns(), back._columns(), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("height_m,delta_m\n0,1\n1,2\n", "column 'delta_mm' is missing"),
        ("height_m,delta_mm\n0,1\n0,2\n", "heights must increase, but 0 m follows 0 m in row 2"),
        ("height_m,delta_mm\n0,1\n1,x\n", "column 'delta_mm', row 2: 'x' is not a finite number"),
        ("height_m,delta_mm,spread_mm\n0,1,-1\n1,2,0\n", "cannot be negative"),
        ("height_m,delta_mm\n0,2300\n1,2100\n", "is no deviation of a rail: use mm"),
        ("", "it is empty"),
    ],
)
def test_faults_of_tables_are_reported(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "profile.csv"
    path.write_text(text)
    with pytest.raises(ParameterError) as error:
        ProfileTable.load(path)
    assert message in str(error.value)
    assert "profile.csv" in str(error.value)


def test_sections_beyond_the_threshold_are_those_of_the_paper() -> None:
    """González et al. 2020: corrective actions at 0.1 m, 0.4 m, 1.1 to 1.3 m, and 1.5 to 1.8 m."""
    result = BENCH.beyond(2.3e-3)
    assert [(round(a, 1), round(b, 1)) for a, b in result] == [(0.0, 0.2), (0.3, 0.5), (1.1, 1.3), (1.5, 1.8)]


def test_ranges_that_a_short_dip_parts_are_one() -> None:
    height = np.linspace(0.0, 2.0, 201)
    delta = np.where((height > 0.395) & (height < 1.205), 3e-3, 2e-3)
    delta[60] = delta[61] = 2e-3  # 20 mm
    delta[85:95] = 2e-3
    result = ProfileTable(height, delta, np.zeros(201)).beyond(2.3e-3)
    np.testing.assert_allclose(result, [(0.4, 0.845), (0.945, 1.2)], atol=0.01)


# -------------------------------------------------------------------- threshold


def test_seventy_percent_of_fourteen_is_the_tenth() -> None:
    made = [
        Configuration(name=f"{k}", median=1e-3 * k, largest=2e-3 * k, energy=10.0 + 2.0 * k) for k in range(14, 0, -1)
    ]
    result = threshold_of(made)
    assert result.level == pytest.approx(10e-3)
    assert len(result.under) == 10
    assert result.interval[0] < result.level < result.interval[1]
    assert result.slope == pytest.approx(2.0e3)
    assert result.correlation == pytest.approx(1.0)
    assert threshold_of(made, 0.5).level == pytest.approx(7e-3)
    assert "10 of 14" in repr(result)
    assert len(result.plot().axes[0].lines) >= 3


def test_a_threshold_needs_configurations_and_a_share() -> None:
    made = [Configuration(name=f"{k}", median=1e-3 * k, largest=2e-3 * k, energy=10.0) for k in range(1, 5)]
    with pytest.raises(ValueError, match="three or more"):
        threshold_of(made[:2])
    with pytest.raises(ValueError, match="between 0 and 1"):
        threshold_of(made, 70.0)
    assert np.isnan(threshold_of(made).correlation)  # all take the same energy


def test_median_goes_over_height_and_not_over_points() -> None:
    """Many points in a bad stretch do not make the whole rail bad."""
    height = np.concatenate([np.linspace(0.0, 0.2, 50), [0.25, 2.0]])
    delta = np.where(height < 0.21, 5e-3, 1e-3)
    result = configuration_of("one", ProfileTable(height, delta, np.zeros(52)), [10.0, 12.0])
    assert result.median == pytest.approx(1e-3)
    assert result.largest == pytest.approx(5e-3, rel=1e-3)
    assert (result.energy, result.energy_std) == (11.0, 1.0)


def test_energy_from_tension_and_acceleration() -> None:
    t = np.linspace(0.0, 5.0, 2001)
    v = 0.4 * np.sin(np.pi * t / 5.0)
    a = np.gradient(v, t)
    tension = 30.0 * (a + 9.80665) + 7.0  # 7 N of friction against the way up
    way = float(np.trapezoid(v, t))
    assert friction_loss(t, tension, a, v, 30.0) == pytest.approx(7.0 * way, rel=1e-3)


# -------------------------------------------------------------------- rails and draws


def test_cutting_leaves_what_is_outside_the_section() -> None:
    rail = RailProfile((0.0, 0.5, 1.0, 1.5), (3e-3, 3e-3, 3e-3, 1e-3))
    cut = _cut(rail, 2e-3, [(0.4, 1.1)])
    assert cut.deviation == (3e-3, 2e-3, 2e-3, 1e-3)


def test_errors_of_a_rail_have_its_spread_and_a_length() -> None:
    table = ProfileTable(np.array([0.0, 2.0]), np.zeros(2), np.array([1e-4, 3e-4]))
    grid, rng = np.linspace(0.0, 2.0, 101), np.random.default_rng(0)
    drawn = np.array([_rail_error(grid, table, rng) for _ in range(2000)])
    np.testing.assert_allclose(drawn.std(axis=0)[[0, 50, 100]], [1e-4, 2e-4, 3e-4], rtol=0.06)
    assert np.corrcoef(drawn[:, 50], drawn[:, 52])[0, 1] > 0.9
    assert abs(np.corrcoef(drawn[:, 20], drawn[:, 80])[0, 1]) < 0.1


def test_uncertainties_from_a_table() -> None:
    result = uncertainties_from({"*.mu": 0.2, "cabin.mass": {"std": 0.5, "relative": False}, "lubrication": 0.02})
    assert result == (
        Uncertainty("*.mu", 0.2),
        Uncertainty("cabin.mass", 0.5, False),
        Uncertainty("lubrication", 0.02, False),
    )
    assert result[0].names() == ("cabin_guide.mu", "counterweight_guide.mu")


def test_impossible_settings_are_reported_together() -> None:
    with pytest.raises(ValueError, match=r"threshold is 2.3 m.*lubrication is -1"):
        what_if(None, BENCH, threshold=2.3, lubrication=-1.0)


# -------------------------------------------------------------------- results and page


def _study(draws: int = 20) -> WhatIf:
    rng = np.random.default_rng(1)

    def energies(e_c: float, e_cw: float) -> tuple[TripEnergy, tuple[TripEnergy, ...]]:
        nominal = TripEnergy(e_c, e_cw, 41.84, 41.84 - e_c - e_cw)
        scale = 1.0 + 0.1 * np.random.default_rng(2).standard_normal(draws)
        return nominal, tuple(TripEnergy(e_c * s, e_cw * s, 41.84, 41.84 - (e_c + e_cw) * s) for s in scale)

    made = {
        "original": (13.87, 7.71),
        "straightened": (12.68, 7.71),
        "lubrication": (12.43, 6.94),
        "both": (11.35, 6.94),
    }
    actions = tuple(Action(n, *energies(*v)) for n, v in made.items())
    section = SectionSaving(
        low=1.07,
        high=1.35,
        worst=1.24,
        deviation=2.95e-3,
        spread=2e-4,
        probability=0.999,
        saving=0.44,
        drawn=tuple(0.44 + 0.05 * rng.standard_normal(draws)),
    )
    return WhatIf(
        actions=actions,
        sections=(section,),
        rail=BENCH,
        threshold=2.3e-3,
        lubrication=0.9,
        direction="up",
        uncertainties=(("*.mu", "10 %"),),
        drawn=({},) * draws,
        seed=0,
    )


def test_savings_are_differences_within_a_draw() -> None:
    study = _study()
    saving = study.saving("lubrication")
    assert saving.value == pytest.approx(13.87 + 7.71 - 12.43 - 6.94)
    # both sides move together, so the saving is known far better than the losses themselves
    assert saving.high - saving.low < 0.2 * (study["original"].figure("E_c").high - study["original"].figure("E_c").low)
    assert study.better("lubrication", "straightened") == 1.0
    assert study.to_frame().loc["eta_t [%]", "original"] == pytest.approx(48.42, abs=0.01)


def test_without_draws_there_is_no_interval() -> None:
    study = _study(0)
    assert np.isnan(study.saving("both").low)
    assert study.saving("both").text() == "3.29"
    assert study.to_json()["actions"]["both"]["saving"]["low"] is None
    assert np.isnan(study.better("both", "original"))


def test_the_summary_names_where_and_how_much() -> None:
    text = summary(_study())
    assert "1.07 to 1.35 m" in text
    assert "Lubrication saves 2.21" in text
    assert "100 % of the draws" in text


def test_the_page_opens_alone_and_the_json_can_be_read(tmp_path: Path) -> None:
    settings = Settings(trips_per_day=300.0, price=0.25)
    page = write_what_if(tmp_path, _study(), settings, lift="a lift")
    text = page.read_text(encoding="utf-8")
    assert 'src="data:image/png' in text
    assert "http" not in text
    assert {p.name for p in tmp_path.iterdir()} == {
        "report.html",
        "what-if.json",
        "rail.png",
        "energies.png",
        "savings.png",
        "run.json",
    }
    content = json.loads((tmp_path / "what-if.json").read_text())
    assert content["actions"]["straightened"]["saving"]["value"] == pytest.approx(1.19)
    year = content["year"]["both"]
    assert year["energy"]["value"] == pytest.approx(3.29 * 300 * 365 / 3.6e6)
    for figure in (year["energy"], year["money"]):
        assert figure["low"] < figure["value"] < figure["high"]
        assert f"{figure['value']:.3g} ({figure['low']:.3g} to {figure['high']:.3g})" in text


def test_an_interval_as_text() -> None:
    assert Interval.of(1.0, [0.5, 1.0, 1.5]).text(2.0, 1) == "2.0 (1.1 to 3.0)"
    assert Interval(0.01, -0.001, 0.11).text() == "0.01 (0.00 to 0.11)"


# -------------------------------------------------------------------- settings


def test_settings_are_read_and_paths_are_beside_them(tmp_path: Path) -> None:
    BENCH.save(tmp_path / "profile.csv")
    (tmp_path / "a.csv").touch()
    (tmp_path / "s.toml").write_text(
        '[profile]\nfile = "profile.csv"\n[trips]\nfiles = ["*.csv"]\ncolumns = { F_c = "tension" }\n'
        '[actions]\nthreshold_mm = 2.0\ndirection = "down"\n[study]\nsamples = 7\n[uncertain]\n"*.mu" = 0.3\n'
    )
    result = read_settings(tmp_path / "s.toml")
    assert result.profile == tmp_path / "profile.csv"
    assert [p.name for p in result.trips] == ["a.csv", "profile.csv"]
    assert (result.threshold, result.samples, result.direction) == (2e-3, 7, "down")
    assert result.uncertainties == (Uncertainty("*.mu", 0.3),)
    assert result.with_options(samples=None, seed=3).samples == 7


def test_all_faults_of_settings_are_reported(tmp_path: Path) -> None:
    path = tmp_path / "s.toml"
    path.write_text(
        '[profil]\n[actions]\nthreshold_mm = 0.0\nlubrikation = 0.9\n[trips]\nfiles = ["none*.csv"]\n'
        "columns = { F_cc = 'x' }\n[[configuration]]\nname = 'one'\n"
    )
    with pytest.raises(ParameterError) as message:
        read_settings(path)
    text = str(message.value)
    for part in (
        "no table [profil]; did you mean 'profile'",
        "no entry 'lubrikation'; did you mean 'lubrication'",
        "threshold_mm is 0.0",
        "no file matches 'none*.csv'",
        "no quantity 'F_cc'",
        "[[configuration]] 1: 'trips' is missing",
    ):
        assert part in text, part


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        ('"*.mu" = -0.1', "'*.mu' = -0.1: give a share from 0 to 1"),
        ('"*.mu" = 100.0', "'*.mu' = 100: give a share from 0 to 1"),
        ('"*.mu" = nan', "'*.mu' = nan: give a share from 0 to 1"),
        ('"cabin.mass" = { std = -1.0, relative = false }', "'cabin.mass' = -1: give a standard deviation of zero"),
        ('"cabin.mass" = { std = inf, relative = false }', "'cabin.mass' = inf: give a standard deviation of zero"),
    ],
)
def test_an_uncertainty_that_cannot_be_is_refused(entry: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "s.toml"
    path.write_text(f"[uncertain]\n{entry}\n")
    with pytest.raises(ParameterError) as message:
        read_settings(path)
    assert f"[uncertain]: {says}" in str(message.value)


def test_masses_from_tensions_at_rest() -> None:
    from estimation.files.record import Record, RecordedSignal

    def record(load: float, friction: float) -> Record:
        t = np.arange(1000) / 500.0
        moving = (t > 0.2).astype(float)
        values = {
            "omega_ref": moving,
            "payload": np.full(1000, load),
            "F_c": (33.0 + load) * 9.80665 + friction + 5.0 * moving,
            "F_cw": np.full(1000, 34.0 * 9.80665),
        }
        return Record(
            name="r",
            path=Path("r"),
            time=t,
            signals={n: RecordedSignal(values=v, unit="", column=n, measured_unit="") for n, v in values.items()},
            log=(),
        )

    result = with_measured_masses(LiftParameters.bench(), [record(0.0, 3.0), record(2.0, 0.0), record(4.0, -3.0)])
    assert result.cabin.mass == pytest.approx(33.0)
    assert result.counterweight.mass == pytest.approx(34.0)
    assert with_measured_masses(LiftParameters.bench(), []) == LiftParameters.bench()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["none.toml"], "there is no such settings file"),
        (["--profile", "none.csv"], "there is no such file: give the profile that `vtsdt align` wrote"),
        (["--lift", "none.toml"], "none.toml"),
        (["--threshold", "-1"], "give a number above zero"),
        (["a.toml", "b.toml"], "give one settings file"),
    ],
)
def test_bad_input_ends_the_command_with_one_message(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from vtsdt.cli.command_line import main

    assert main(["what-if", *words, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error
    assert not (tmp_path / "out").exists()
