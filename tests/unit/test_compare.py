"""What compare says about a stage."""

from __future__ import annotations

import numpy as np
import pytest

from discrepancy.questions.compare import compare


def test_every_part_record_and_output_is_compared(small_study) -> None:
    table = compare(small_study.stages[1]).to_frame()
    assert list(zip(table.part, table.record, table.output, strict=True)) == [
        ("identify", "forth_and_back", "drive.force"),
        ("identify", "forth_and_back", "carriage.position"),
        ("validate", "with_rests", "drive.force"),
        ("validate", "with_rests", "carriage.position"),
    ]


def test_figures_are_those_of_the_residual(small_study) -> None:
    stage = small_study.stages[1]
    found = compare(stage)
    residual = stage.fits("validate")[0].residual
    signal = found.of("validate", output="drive.force")[0]
    assert np.array_equal(signal.residual, residual[:, 0])
    assert signal.figures.rmse == pytest.approx(stage.rmse("validate")["drive.force"], rel=1e-12)
    assert signal.over_noise == pytest.approx(signal.figures.rmse / stage.noise["drive.force"], rel=1e-12)
    assert found.pooled("validate")["drive.force"].max_error == np.abs(residual[:, 0]).max()
    assert signal.energy_share == pytest.approx(signal.figures.nrmse**2, rel=1e-9)


def test_missing_friction_shows_as_missing_work(small_study) -> None:
    """Dry friction takes force times way out of the machine; a model without it must show less work."""
    given, _, better = (compare(s).of("validate", output="drive.force")[0] for s in small_study.stages)
    way = np.sum(
        np.abs(
            np.diff(
                given.model * 0 + compare(small_study.stages[0]).of("validate", output="carriage.position")[0].model
            )
        )
    )
    lost = small_study.hidden.strengths["coulomb"] * way
    assert given.work is not None
    assert better.work is not None
    assert given.work.along == "carriage.position"
    # The viscous friction of the model as given is 9 N·s/m too small, which is up to a third of the dry one
    # here.
    assert 0.9 * lost < given.work.measured - given.work.model < 1.5 * lost
    assert better.work.model == pytest.approx(better.work.measured, rel=0.01)


def test_spectrum_holds_the_energy_of_the_residual(small_study) -> None:
    signal = compare(small_study.stages[1]).of("identify", output="drive.force")[0]
    frequency, density = signal.spectrum()
    # Welch's windows and the mean that is taken out of each segment leave most of a broad residual's energy.
    assert np.trapezoid(density, frequency) == pytest.approx(np.mean(signal.residual**2), rel=0.4)
    frequency, value = signal.coherence()
    assert value.min() >= 0.0
    assert value.max() <= 1.0 + 1e-12
    assert value[frequency < 0.5].max() > 0.8


def test_plot_has_a_row_for_each_output_and_refuses_unknown_records(small_study) -> None:
    found = compare(small_study.stages[1])
    figure = found.plot("validate")
    assert len(figure.axes) == 6
    assert "N" in figure.axes[0].get_ylabel()
    with pytest.raises(KeyError, match="with_rests"):
        found.plot("validate", "other")


def test_repr_is_a_table(small_study) -> None:
    text = repr(compare(small_study.stages[1]))
    assert "drive.force" in text
    assert "/noise" in text
