"""Kinds of effect that leave nearly the same trace, and in which records."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["ALIKE", "taken_for"]


@dataclass(frozen=True)
class Alike:
    """Kinds that records cannot tell apart under a condition: ``where``, as the end of a sentence."""

    kinds: tuple[str, ...]
    where: str


ALIKE = (
    Alike(("coulomb_friction", "stribeck_friction", "hysteresis"), "where no record moves slowly or reverses often"),
    Alike(("coulomb_friction", "asymmetric_coulomb_friction", "constant_force"), "where all run in one direction"),
    Alike(
        ("coulomb_friction", "brush_voltage_drop", "inverter_dead_time"), "where the current has the sign of the speed"
    ),
    Alike(
        (
            "coulomb_friction",
            "load_dependent_friction",
            "quadratic_load_friction",
            "stribeck_load_friction",
            "directional_load_friction",
        ),
        "where the load hardly changes",
    ),
    Alike(("coulomb_friction", "position_dependent_friction", "local_bump"), "where little of the travel is used"),
    Alike(("coulomb_friction", "friction_drift", "friction_with_temperature"), "where records are short"),
    Alike(("friction_drift", "friction_with_temperature"), "where the temperature rises steadily"),
    Alike(("viscous_friction", "quadratic_drag", "asymmetric_viscous_friction"), "where one speed is run, one way"),
    Alike(("viscous_friction", "viscous_drift", "viscous_with_temperature"), "where records are short"),
    Alike(("viscous_drift", "viscous_with_temperature"), "where the temperature rises steadily"),
    Alike(("viscous_friction", "resistance", "torque_constant", "magnet_flux"), "where a motor keeps its speed"),
    Alike(("extra_damping", "slip", "hysteresis"), "where it vibrates at one frequency and size"),
    Alike(("extra_damping", "asymmetric_viscous_friction"), "where both directions are alike"),
    Alike(
        ("linear_stiffness", "cubic_stiffness", "position_dependent_force", "constant_force"),
        "where little of the travel is used",
    ),
    Alike(("linear_stiffness", "stiffness_drift", "stiffness_with_temperature"), "where records are short"),
    Alike(("stiffness_drift", "stiffness_with_temperature"), "where the temperature rises steadily"),
    Alike(("backlash", "cubic_stiffness", "end_stop"), "where all motions have one size"),
    Alike(("angle_harmonic", "position_dependent_force", "local_bump"), "where fewer than two periods are passed"),
    Alike(("added_inertia", "attached_mass"), "well below its natural frequency"),
    Alike(("attached_mass", "linear_stiffness", "extra_damping"), "where only one frequency is excited"),
    Alike(("sensor_offset", "constant_force", "input_offset"), "where nothing else fixes the zero"),
    Alike(("sensor_gain", "input_gain", "added_inertia", "torque_constant"), "where one output is measured"),
    Alike(
        ("sensor_delay", "sensor_lag", "input_delay", "input_lag"),
        "where signals are slow against it",
    ),
    Alike(("sensor_drift", "friction_drift", "viscous_drift"), "where one record is measured"),
    Alike(
        ("proportional_gain", "integral_gain", "position_loop_gain", "speed_loop_gain", "current_loop_gain"),
        "where the reference changes slowly",
    ),
    Alike(("resistance", "brush_voltage_drop", "inverter_dead_time"), "where the current keeps its size"),
    Alike(("laminar_leakage", "turbulent_leakage", "flow_loss"), "where the pressure keeps its size"),
    Alike(("heat_loss", "radiation_loss"), "where the temperature stays in a narrow range"),
)


def taken_for(kind: str) -> list[tuple[str, str]]:
    """Return what a kind is taken for: the other kind, and where.

    Examples
    --------
    >>> taken_for("heat_loss")
    [('radiation_loss', 'where the temperature stays in a narrow range')]
    """
    return [(other, group.where) for group in ALIKE if kind in group.kinds for other in group.kinds if other != kind]
