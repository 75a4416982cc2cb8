"""The gear stage that users run: the model, its static state, simulations and vibration signals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gearbox.files.operating_condition import OperatingCondition
from gearbox.parts.housing_modes import AXES, SENSORS
from gearbox.signals.signal import Signal
from gearbox.stage.model import GearModel, Structure
from gearbox.stage.running import run
from gearbox.stage.static_equilibrium import moving_state, static_state
from multibody.machine.model import Model
from multibody.system.trajectory import Trajectory

__all__ = ["GearStage", "build", "simulate"]

#: Sampling rate of simulated signals, Hz: that of the paper's measurement.
VIBRATION_RATE = 25_600.0
#: The vibration is within 2e-4 of its RMS of that at a tolerance of 1e-7, at Table 2's point, at the updated one and at
#: C_D 860 N s/mm with e_F 2.5 (docs, "Gear stage", Speed).
_VIBRATION_METHOD: dict[str, Any] = {"method": "auto", "rtol": 3e-5, "atol": 3e-9}
#: Time for the start to die away, s: the rigid housing's slowest motion then leaves 0.1 % off the mesh lines.
_VIBRATION_SETTLE = 0.3


class GearStage(GearModel):
    """A gear stage: a model (`gearbox.stage.model.GearModel`) with its analyses.

    Inputs are ``speed`` (rad/s, of the drive) and ``torque`` (N m, load on the output shaft, positive against its
    turning).  Outputs are the accelerometers ``a_<sensor>_<axis>`` with the sensors input_seat, output_seat and base,
    ``mesh_force``, ``back_force``, ``transmission_error``, ``drive_torque``, ``speed_1``, ``speed_2``.

    Parameters
    ----------
    parameters : StageParameters, optional
        Default: the paper's stage.
    structure : Structure, optional
        Default: all motions free, flexible housing.
    modes : ModeSet, optional
        Of the housing; default: the shipped set for ``housing="flexible"``, a rigid body on mounts for ``"rigid"``.
    name : str

    Raises
    ------
    GearError
        With everything that does not fit together.

    Examples
    --------
    >>> stage = GearStage.paper()
    >>> len(stage.system.states)
    58
    """

    def _repr_html_(self) -> str:
        from multibody.base.notebook import notebook_view, small_figure

        pair = self.pair
        rows = [
            ("teeth", f"{pair.teeth_1} / {pair.teeth_2}"),
            ("normal module, width", f"{1e3 * pair.module:g} mm, {1e3 * pair.width:g} mm"),
            ("helix angle", f"{np.degrees(pair.helix_angle):.3g}°"),
            ("housing", self.structure.housing),
            ("components, states", f"{len(self.components)}, {len(self.system.states)}"),
        ]
        # The mesh and its first sidebands by a turn of either shaft, in orders of the input shaft.
        mesh = pair.teeth_1 * np.arange(1.0, 4.0)
        sides = (1.0, pair.teeth_1 / pair.teeth_2)
        lines = np.unique([m + sign * side for m in mesh for side in sides for sign in (-1, 0, 1)])
        height = np.where(np.isin(lines, mesh), 1.0, 0.3)
        x = np.repeat(lines, 3)
        y = np.stack([np.zeros_like(height), height, np.zeros_like(height)], axis=1).ravel()
        figure = small_figure(
            x, [("drawn height [1]", {"mesh lines and sidebands": y})], across="order of the input shaft [1]"
        )
        return notebook_view(f"Gear stage '{self.name}'", rows, figure=figure)

    def simulate(self, speed: float, torque: float, duration: float = 1.0, **options: Any) -> Trajectory:
        """Run the stage at a speed (r/min) under a load (N m); see `gearbox.stage.running.run`."""
        return run(self, speed, torque, duration, **options)

    def moving(self, speed: float, torque: float, **options: Any) -> Model:
        """Return the stage as a plain model that starts in motion, as a study file's ``build`` has to return it.

        Parameters
        ----------
        speed : float, r/min
        torque : float, N m
        options
            Further arguments of `gearbox.stage.running.static_state`.
        """
        state = moving_state(self, speed, torque, **options)
        return self.with_values(dict(zip(self.system.state_names, map(float, state), strict=True)))

    def static_state(self, torque: float, **options: Any) -> NDArray[np.float64]:
        """Return the state at rest under a load; see `gearbox.stage.running.static_state`."""
        return static_state(self, torque, **options)

    def vibration(
        self,
        values: Mapping[str, float],
        condition: OperatingCondition,
        duration: float,
        rate: float = VIBRATION_RATE,
        more: Sequence[str] = (),
    ) -> dict[str, Signal]:
        """Return settled signals of the accelerometers.

        Parameters
        ----------
        values : mapping of str to float
            ``K`` (N at 1 mm), ``C_D`` (N s/m), ``e_F``, ``D_P`` (m), ``E`` (Pa), ``rho`` (kg/m³) or full names of model
            parameters, SI.  ``E`` acts through K, and therefore not where K is given.
        condition : OperatingCondition
        duration : float, s
        rate : float, Hz
        more : sequence of str
            Other outputs to return as well, such as ``"transmission_error"``.
        """
        run = self.simulate(
            condition.speed_rpm,
            condition.load_Nm,
            duration,
            rate=rate,
            settle=_VIBRATION_SETTLE,
            parameters=self.values(**values),
            **_VIBRATION_METHOD,
        )
        names = [*(name for name in self.outputs if name.startswith("a_")), *more]
        return {name: Signal(run[name], rate, name=name, unit=run.unit(name)) for name in names}


def build(
    housing: str = "flexible", imperfect: bool = False, bearing_defects: bool = False, slices: int = 0
) -> GearStage:
    """Return the paper's stage; keywords are those of :class:`gearbox.stage.model.Structure`.

    It is what ``[model] build = "gearbox.stage:build"`` of a study file names.
    """
    structure = Structure(housing=housing, imperfect=imperfect, bearing_defects=bearing_defects, slices=slices)
    return GearStage(None, structure)


@lru_cache(maxsize=1)
def _paper_stage() -> GearStage:
    return GearStage.paper()


def simulate(
    parameters: Mapping[str, float],
    speed: float,
    torque: float,
    duration: float,
    sample_rate: float,
    *,
    stage: GearStage | None = None,
    **options: Any,
) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
    """Simulate a gear stage in steady running and return what its accelerometers see.

    Parameters
    ----------
    parameters : mapping of str to float
        Physical parameters that differ from the stage's, SI: ``K`` (N at 1 mm, the paper's N/mm^e), ``C_D`` (N s/m),
        ``e_F``, ``D_P`` (m), ``E`` (Pa), ``rho`` (kg/m³) of gears and shafts, or any parameter of the model by its
        full name, such as ``"input_low.clearance"``.  ``E`` acts through K (Hertz: K ∝ E), and not where K is given.
    speed : float, r/min
        Of the driving gear.
    torque : float, N m
        Load on the output shaft.
    duration : float, s
        Length of the record; it begins when the start has settled.
    sample_rate : float, Hz
    stage : GearStage, optional
        Default: the paper's stage.
    options
        Further arguments of `gearbox.stage.running.run`, such as ``settle``.

    Returns
    -------
    time : ndarray, shape (n,), s
        From 0; n = duration · sample_rate.
    accelerations : dict of str to ndarray, shape (n,), m/s²
        ``a_<sensor>_<axis>`` for the sensors input_seat, output_seat, base and the axes x, y, z.

    Raises
    ------
    GearError
        With every unknown parameter and every number that makes no sense.
    """
    if stage is None:
        stage = _paper_stage()
    run = stage.simulate(speed, torque, duration, rate=sample_rate, parameters=stage.values(**parameters), **options)
    names = [f"a_{sensor}_{axis}" for sensor in SENSORS for axis in AXES]
    return run.times, {name: run[name] for name in names}
