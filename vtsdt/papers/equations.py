"""González et al. 2020 equation by equation: where each stands in the code, and how far it is from the printed one.

Every equation is written here once more, with arrays alone, and held against the compiled model at random states of the
reference model, and against the compiled filter on a short trip.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np

from discrepancy.validation.published import PaperChapter, PaperRow, claimed
from multibody.base.gravity import STANDARD_GRAVITY
from vtsdt.files.parameters import LiftParameters
from vtsdt.lift.lift import Lift
from vtsdt.papers.printed import PAPER

__all__ = ["equations_chapter"]

STATES, SEED = 200, 31
#: Largest relative difference that rounding explains, of one evaluation and of a filter over a trip.
EXACT, FILTERED = 1e-9, 1e-9
#: Samples of the trip of the filter, at 1 kHz.
SAMPLES = 200


def equations_chapter() -> PaperChapter:
    """Return the chapter of Eqs. 1 to 31."""
    rows = [*_model_rows(), *_filter_rows()]
    text = (
        f"Largest difference over {STATES} random states of the reference model (Eqs. 1 to 19), and over {SAMPLES} "
        "steps of the joint filter on the cabin model (Eqs. 20 to 31), relative to the largest value of the quantity. "
        "An equation is written from the paper both there and here, so that an agreement shows no more than that "
        "neither program has a slip. Where the print is garbled or has a slip, the row says so; it then differs from "
        "the print and agrees with the equation as it must read.\n\n" + SLIPS
    )
    return PaperChapter(paper=PAPER, place="Eqs. 1 to 31", title="equation by equation", rows=tuple(rows), text=text)


def _row(number: str, printed: str, place: str, difference: float, note: str = "", bar: float = EXACT) -> PaperRow:
    where = f"`{place}`" + (f"; {note}" if note else "")
    return claimed(number, printed, f"{difference:.1e}", difference, high=bar, bar=where)


def _apart(ours: Any, theirs: Any) -> float:
    a, b = np.asarray(ours, dtype=float), np.asarray(theirs, dtype=float)
    return float(np.abs(a - b).max() / max(np.abs(b).max(), 1e-300))


#: Where the print is at odds with itself or with mechanics, and what the code takes.
SLIPS = """| where | slip of the print | here |
| --- | --- | --- |
| Eq. 3 | negative normal force in contact | depth of the contact, never negative |
| Eq. 11 | no weight and no inertia of the rope at the pulley | both are in |
| Eq. 15 | multiplies by K_T where a torque demand becomes a current | as printed; `divides=True` divides |
| Eq. 25, Table 2 | no unit of Q: per step or per second | per second; both are tried under Table 2 |
| Eqs. 26, 29 | sign of the residual | reading minus prediction |
| Eq. 30 | H of the step before | H of this step, Joseph's form |
| Table 1 | the text gives the 1D model's support two DoF, table and count three | three |
| Table 4 | E_m has a minus in three of six columns; η_t is not E_out/E_in with the printed E_m | E_m positive \
where the machine brakes; η_t with the machine's energy from the balance |
"""


# -------------------------------------------------------------------- Eqs. 1 to 19


def _bench() -> LiftParameters:
    """The bench without what Eqs. 3 and 4 leave out: damping of the contact, and sliding that is not full."""
    bench = LiftParameters.bench()
    cabin, counterweight = (
        dataclasses.replace(guide, damping=0.0, v_s=1e-3) for guide in (bench.cabin_guide, bench.counterweight_guide)
    )
    return dataclasses.replace(bench, cabin_guide=cabin, counterweight_guide=counterweight)


def _model_rows() -> Iterator[PaperRow]:
    bench = _bench()
    system = Lift.reference(bench).build()
    names, outputs = system.state_names, system.output_names
    rng = np.random.default_rng(SEED)
    compared: dict[str, list[tuple[Any, Any]]] = {}

    def note(equation: str, ours: Any, theirs: Any) -> None:
        compared.setdefault(equation, []).append((ours, theirs))

    for _ in range(STATES):
        x = _random_state(bench, names, rng)
        u = np.array([rng.uniform(-5.0, 5.0), rng.uniform(-2.0, 2.0)])
        s = dict(zip(names, x, strict=True))
        rate = dict(zip(names, system.rhs(0.0, x, u, system.p), strict=True))
        y = dict(zip(outputs, system.outputs_at(0.0, x, u, system.p), strict=True))
        _bodies(bench, s, rate, y, note)
        _ropes_and_pulley(bench, s, rate, y, float(u[1]), note)
        _machine(bench, s, rate, y, float(u[0]), note)
    apart = {k: _apart([p[0] for p in pairs], [p[1] for p in pairs]) for k, pairs in compared.items()}
    guide, rope, machine, control = (f"vtsdt.parts.{n}" for n in ("guide", "rope", "machine", "control"))
    body = "multibody.declare.rigid_body.RigidBody"
    yield _row("Eq. 1", "ΣF = m (a₀ + ω̇ × r + ω × (ω × r))", body, apart["1"], "both cars")
    yield _row("Eq. 2", "ΣM = I ω̇ + ω × I ω + r × F", body, apart["2"], "I about the centre of mass; r × F is r × ΣF")
    yield _row(
        "Eq. 3 as printed",
        "F_N = K (s_s − δ − L_g)",
        f"{guide}.face",
        apart["3 printed"],
        "negative in contact: a slip",
    )
    yield _row("Eq. 3", "F_N = K (depth), ≥ 0", f"{guide}.face", apart["3"], "without the damping that the text names")
    yield _row("Eq. 4", "F_f = μ F_N", f"{guide}.shoe", apart["4"], "against the speed, with tanh(v/v_s)")
    for k, what in (("5", "L_c = L₀ + R_p φ"), ("6", "L_cw = L₀ − R_p φ"), ("7", "K_c = EA n/L_c")):
        yield _row(f"Eq. {k}", what, f"{rope}.Ropes", apart[k])
    for k, what in (("8", "K_cw = EA n/L_cw"), ("9", "m_c = λ_m L_c"), ("10", "m_cw = λ_m L_cw")):
        yield _row(f"Eq. {k}", what, f"{rope}.Ropes", apart[k])
    yield _row(
        "Eq. 11 as printed",
        "J_p α = R_p (F_c − F_cw) + τ_e + τ_L",
        f"{rope}.DrivingPulley",
        apart["11 printed"],
        "leaves out weight and inertia of the rope at the pulley, which Eqs. 9 and 10 introduce",
    )
    yield _row("Eq. 11", "with weight and inertia of the rope", f"{rope}.Ropes", apart["11"])
    yield _row("Eq. 12", "V_q = R i_q + L_q di_q/dt + p ω (L_d i_d + λ)", f"{machine}.GearedPMSM", apart["12"], _GEAR)
    yield _row("Eq. 13", "V_d = R i_d + L_d di_d/dt − p ω L_q i_q", f"{machine}.GearedPMSM", apart["13"], _GEAR)
    yield _row("Eq. 14", "τ_e = K_T i_q", f"{machine}.GearedPMSM", apart["14"], "times the gear's ratio at the pulley")
    yield _row(
        "Eq. 15",
        "i_q* = K_T K_pω (e + ∫e/T)",
        f"{control}.FieldOrientedControl",
        apart["15"],
        "as printed; a torque demand becomes a current by division: `divides=True`",
    )
    yield _row("Eq. 16", "V_q = K_pq (e + ∫e/T)", f"{control}.FieldOrientedControl", apart["16"])
    yield _row("Eq. 17", "V_d = K_pd (e + ∫e/T)", f"{control}.FieldOrientedControl", apart["17"])
    yield _row("Eq. 18", "y = K_p (u + x), dx/dt = u/T_i", f"{control}.FieldOrientedControl", apart["18"])
    yield _row("Eq. 19", "f = |λ|/2π", "vtsdt.lift.modes.modes_of", _frequencies(system, names), "", 1e-6)


_GEAR = "ω is the motor's: the gear's ratio times the pulley's"


def _random_state(bench: LiftParameters, names: tuple[str, ...], rng: np.random.Generator) -> np.ndarray:
    """A state with shoes pressed and loose, ropes taut, and a cabin that slides."""
    scale = {"x": 1.5e-3, "y": 1.5e-3, "roll": 3e-3, "pitch": 3e-3, "yaw": 3e-3}
    fast = {"v_x": 0.05, "v_y": 0.05, "w_x": 0.1, "w_y": 0.1, "w_z": 0.1}
    values = {n: float(rng.normal()) * 1e-3 for n in names}
    angle = -float(rng.uniform(0.0, 1.9)) / bench.pulley.R_p
    values["pulley.angle"] = angle
    values["pulley.speed"] = float(rng.uniform(2.0, 5.0)) * float(rng.choice([-1.0, 1.0]))
    for side, sign, base in (("cabin", -1.0, 0.0), ("counterweight", 1.0, bench.hoistway.travel)):
        for n, size in {**scale, **fast}.items():
            values[f"{side}.{n}"] = float(rng.uniform(-size, size))
        values[f"{side}.z"] = base + sign * bench.pulley.R_p * angle - 3e-3
        values[f"{side}.v_z"] = sign * bench.pulley.R_p * values["pulley.speed"]
    for n in ("machine.i_d", "machine.i_q", "control.x_d", "control.x_q", "control.x_omega"):
        values[n] = float(rng.uniform(-2.0, 2.0))
    return np.array([values[n] for n in names])


def _attitude(roll: float, pitch: float, yaw: float) -> np.ndarray:
    c, s = np.cos, np.sin
    x = np.array([[1, 0, 0], [0, c(roll), -s(roll)], [0, s(roll), c(roll)]])
    y = np.array([[c(pitch), 0, s(pitch)], [0, 1, 0], [-s(pitch), 0, c(pitch)]])
    z = np.array([[c(yaw), -s(yaw), 0], [s(yaw), c(yaw), 0], [0, 0, 1]])
    return np.asarray(z @ y @ x, dtype=float)


def _bodies(bench: LiftParameters, s: dict, rate: dict, y: dict, note: Any) -> None:
    """Eqs. 1 to 4 for cabin and counterweight: all forces on the body, worked out from where it is."""
    arm = s["support.plate_position"] - bench.support.arm * s["support.tilt_B_angle"]
    rise = s["support.plate_velocity"] - bench.support.arm * s["support.tilt_B_speed"]
    for side, tag, sign in (("cabin", "c", 1.0), ("counterweight", "cw", -1.0)):
        body, guide = getattr(bench, side), getattr(bench, f"{side}_guide")
        turn = _attitude(*(s[f"{side}.{n}"] for n in ("roll", "pitch", "yaw")))
        place, speed, spin, wdot, a0 = (
            np.array([d[f"{side}.{n}"] for n in axes])
            for d, axes in (
                (s, ("x", "y", "z")),
                (s, ("v_x", "v_y", "v_z")),
                (s, ("w_x", "w_y", "w_z")),
                (rate, ("w_x", "w_y", "w_z")),
                (rate, ("v_x", "v_y", "v_z")),
            )
        )
        forces = [(np.array(body.com), np.array([0.0, 0.0, -body.mass * STANDARD_GRAVITY]))]
        hitch = np.array([0.0, 0.0, body.hitch])
        at, moving = place + turn @ hitch, speed + turn @ np.cross(spin, hitch)
        free = bench.ropes.L_0_c if side == "cabin" else bench.ropes.L_0_cw
        rim = free + body.hitch + (bench.hoistway.travel if side == "counterweight" else 0.0) + arm
        line = np.array([0.0, 0.0, rim]) - at
        distance = float(np.linalg.norm(line))
        line = line / distance
        pay = sign * bench.pulley.R_p
        length = free + pay * s["pulley.angle"]
        stretching = line[2] * rise - line @ moving - pay * s["pulley.speed"]
        tension = (bench.ropes.EA * bench.ropes.n * (distance - length) + bench.ropes.damping * stretching) / length
        tension = max(tension, 0.0) if distance > length else 0.0
        forces.append((hitch, tension * line))
        normal_sum, printed, friction = 0.0, 0.0, 0.0
        for way in (-1.0, 1.0):
            for height in (body.shoe_low, body.shoe_high):
                point = np.array([way * body.shoe_x, 0.0, height])
                p, v = place + turn @ point, speed + turn @ np.cross(spin, point)
                rail = guide.right_x if way > 0 else guide.left_x
                delta = rail.at(float(p[2])) if rail is not None else 0.0
                depths = (way * (p[0] - way * body.shoe_x) + delta - guide.clearance,
                          p[1] - guide.clearance, -p[1] - guide.clearance)  # fmt: skip
                tip, front, back = (guide.stiffness * max(d, 0.0) for d in depths)
                # Eq. 3 measures s_s - δ towards the rail: in contact it is smaller than L_g, and K times it negative
                printed += sum(guide.stiffness * min(-d, 0.0) for d in depths)
                rubbing = -guide.mu * (tip + front + back) * float(np.tanh(v[2] / guide.v_s))
                normal_sum += tip + front + back
                friction += rubbing
                forces.append((point, np.array([-way * tip, back - front, rubbing])))
        total = sum(f for _, f in forces)
        spin_w, wdot_w, com_w = turn @ spin, turn @ wdot, turn @ np.array(body.com)
        inertial = body.mass * (a0 + np.cross(wdot_w, com_w) + np.cross(spin_w, np.cross(spin_w, com_w)))
        note("1", inertial, total)
        moment = sum(np.cross(turn @ r, f) for r, f in forces)
        tensor = np.diag(np.array(body.inertia, dtype=float)[:3])
        turning = turn @ (tensor @ wdot + np.cross(spin, tensor @ spin)) + np.cross(com_w, total)
        note("2", turning, moment)
        note("3", y[f"{side}_guide.normal"], normal_sum)
        note("3 printed", y[f"{side}_guide.normal"], printed)
        note("4", y[f"{side}_guide.friction"], friction)
        note("F", y[f"ropes.F_{tag}"], tension)


def _ropes_and_pulley(bench: LiftParameters, s: dict, rate: dict, y: dict, loss: float, note: Any) -> None:
    ropes, r = bench.ropes, bench.pulley.R_p
    length = {"c": ropes.L_0_c + r * s["pulley.angle"], "cw": ropes.L_0_cw - r * s["pulley.angle"]}
    for k, side in (("5", "c"), ("6", "cw")):
        note(k, y[f"ropes.L_{side}"], length[side])
    for k, side in (("7", "c"), ("8", "cw")):
        note(k, y[f"ropes.K_{side}"], ropes.EA * ropes.n / length[side])
    for k, side in (("9", "c"), ("10", "cw")):
        note(k, y[f"ropes.m_{side}"], ropes.lambda_m * length[side])
    torque = y["machine.torque"] + loss
    printed = r * (y["ropes.F_c"] - y["ropes.F_cw"]) + torque
    note("11 printed", bench.pulley.J_p * rate["pulley.speed"], printed)
    carried = printed + r * STANDARD_GRAVITY * ropes.lambda_m * (length["c"] - length["cw"])
    inertia = bench.pulley.J_p + ropes.lambda_m * (ropes.L_0_c + ropes.L_0_cw) * r**2
    note("11", inertia * rate["pulley.speed"], carried)


def _machine(bench: LiftParameters, s: dict, rate: dict, y: dict, reference: float, note: Any) -> None:
    m, c = bench.motor, bench.control
    i_d, i_q, omega = s["machine.i_d"], s["machine.i_q"], m.gear * s["pulley.speed"]
    v_q = m.R * i_q + m.L_q * rate["machine.i_q"] + m.pole_pairs * omega * (m.L_d * i_d + m.psi)
    v_d = m.R * i_d + m.L_d * rate["machine.i_d"] - m.pole_pairs * omega * m.L_q * i_q
    note("12", v_q, y["control.V_q"])
    note("13", v_d, y["control.V_d"])
    note("14", y["machine.torque"], m.gear * m.K_T * i_q)
    error = reference - s["pulley.speed"]
    wanted = c.K_T * c.K_pomega * (error + s["control.x_omega"])
    note("15", y["control.i_q_ref"], wanted)
    note("16", y["control.V_q"], c.K_pq * (wanted - i_q + s["control.x_q"]))
    note("17", y["control.V_d"], c.K_pd * (-i_d + s["control.x_d"]))
    inner = (error / c.T_iomega, (wanted - i_q) / c.T_iq, -i_d / c.T_id)
    note("18", [rate[f"control.x_{n}"] for n in ("omega", "q", "d")], inner)


def _frequencies(system: Any, names: tuple[str, ...]) -> float:
    """Eq. 19 with a Jacobian by central differences."""
    from vtsdt.lift.modes import modes_of

    lift = Lift.reference(_bench())
    x = np.asarray(lift.equilibrium(0.5).state)
    u = np.zeros(2)
    columns = []
    for k in range(x.size):
        step = np.zeros(x.size)
        step[k] = 1e-7
        columns.append((system.rhs(0.0, x + step, u, system.p) - system.rhs(0.0, x - step, u, system.p)) / 2e-7)
    values = np.linalg.eigvals(np.array(columns).T)
    ours = modes_of(system.jacobian("x", 0.0, x), names).frequency
    size = np.abs(values[values.imag > 0]) / (2.0 * np.pi)
    return float(max(np.min(np.abs(size / f - 1.0)) for f in ours))


# -------------------------------------------------------------------- Eqs. 20 to 31


def _filter_rows() -> Iterator[PaperRow]:
    correct, printed = _textbook(1.0), _textbook(-1.0)
    kalman = "estimation.filters.extended_kalman_filter"
    yield _row("Eq. 20", "dx/dt = f + w, y = h + v", "estimation.filters.FilterModel", correct["model"])
    yield _row(
        "Eqs. 21, 22", "prediction of x and y", kalman, correct["predicted"], "Runge and Kutta's method of order 4"
    )
    yield _row("Eq. 23", "F = exp(∂f/∂x δt)", kalman, correct["transition"], "central differences here", 1e-6)
    yield _row("Eqs. 24, 25, 27, 28", "H, P⁻, S, K", kalman, correct["covariance"], "through P⁺", 1e-6)
    yield _row(
        "Eqs. 26, 29 as printed",
        "r = ŷ − y, x̂⁺ = x̂⁻ + K r",
        kalman,
        printed["updated"],
        "away from the reading: a slip",
    )
    yield _row("Eqs. 26, 29", "r = y − ŷ, x̂⁺ = x̂⁻ + K r", kalman, correct["updated"], "", 1e-6)
    yield _row(
        "Eq. 30 as printed", "P⁺ = (I − K H_k) P⁻", kalman, correct["printed 30"], "the index must be k + 1: a slip"
    )
    yield _row("Eq. 30", "P⁺ = (I − K H_(k+1)) P⁻", kalman, correct["covariance"], "Joseph's form in the code", 1e-6)
    yield _row(
        "Eq. 31", "d(x, p)/dt = (f, 0)", "estimation.filters.RandomWalk", correct["joint"], "δ has no motion of its own"
    )


def _textbook(sign: float) -> dict[str, float]:
    """Each step of the filter from its own last estimate, by the printed equations; ``sign`` of the innovation."""
    from scipy.linalg import expm

    from estimation.filters import FilterModel, FilterSamples, RandomWalk, extended_kalman_filter
    from vtsdt.alignment.filter import DELTA, GuideFilter
    from vtsdt.papers.alignment import calibrated_bench

    trip = calibrated_bench().trips[0]
    sensor = GuideFilter(parameters=LiftParameters.bench())
    walk = RandomWalk(DELTA, rate=sensor.tuning.process["delta"], std=1e-3)
    model = FilterModel(sensor.system, ["z_c", "zdd_c"], [walk])
    readings = np.column_stack([trip.height, trip.acceleration])
    samples = FilterSamples(trip.time[:SAMPLES], trip.tension[:SAMPLES], readings[:SAMPLES])
    run = extended_kalman_filter(model, samples, sensor.noise(), sensor.prior(trip), hold=True, keep="everything")
    system, n = sensor.system, len(sensor.system.state_names)
    at = system.index("parameter", DELTA)
    rows = [system.index("output", name) for name in ("z_c", "zdd_c")]
    step = float(trip.time[1] - trip.time[0])
    process, noise = run.noise.of(model)
    q, r = np.asarray(process) * step, np.diag(np.asarray(noise))

    def f(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        p = system.p.copy()
        p[at] += x[n]
        return np.append(system.rhs(0.0, x[:n], u, p), 0.0)

    def h(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        p = system.p.copy()
        p[at] += x[n]
        return np.asarray(system.outputs_at(0.0, x[:n], u, p))[rows]

    def slopes(function: Any, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        columns = []
        for k in range(x.size):
            d = np.zeros(x.size)
            d[k] = 1e-7
            columns.append((function(x + d, u) - function(x - d, u)) / 2e-7)
        return np.array(columns).T

    assert run.covariances is not None  # everything is kept
    gaps: dict[str, list[float]] = {}

    def note(name: str, ours: np.ndarray, theirs: np.ndarray, scale: np.ndarray) -> None:
        gaps.setdefault(name, []).append(float((np.abs(ours - theirs) / scale).max()))

    for k in range(1, SAMPLES, 5):
        x, p, u = run.states[k - 1], run.covariances[k - 1], samples.inputs[k - 1]
        k1 = f(x, u)
        k2 = f(x + 0.5 * step * k1, u)
        k3 = f(x + 0.5 * step * k2, u)
        before = x + step / 6.0 * (k1 + 2 * k2 + 2 * k3 + f(x + step * k3, u))
        now = samples.inputs[k]
        last, here, transition = slopes(h, x, u), slopes(h, before, now), expm(slopes(f, x, u) * step)
        wide = transition @ p @ transition.T + q
        gain = wide @ here.T @ np.linalg.inv(here @ wide @ here.T + r)
        after = before + sign * gain @ (samples.readings[k] - h(before, now))
        spread = np.sqrt(np.diag(wide))
        note("model", np.diff(run.predicted[k] - before), np.zeros(n), spread[:-1])
        note("predicted", run.predicted[k], before, spread)
        note("transition", run.kept["transitions"][k], transition, np.abs(transition).max() * np.ones_like(transition))
        note("updated", run.states[k], after, spread)
        note("covariance", run.covariances[k], (np.eye(n + 1) - gain @ here) @ wide, np.outer(spread, spread))
        note("printed 30", run.covariances[k], (np.eye(n + 1) - gain @ last) @ wide, np.outer(spread, spread))
        note("joint", run.predicted[k][n:], x[n:], spread[n:])
    return {name: max(values) for name, values in gaps.items()}
