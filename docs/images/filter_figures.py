"""Make the figures of the page about filters: ``python docs/images/filter_figures.py``.

Data that fulfil the filter's assumptions: the machine is simulated step by step with noise of exactly the covariance
that the filter assumes, and its readings are white.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from estimation.filters import FilterModel, FilterSamples, Noise, Prior, RandomWalk, extended_kalman_filter, nees
from vtsdt.alignment.filter import DELTA, GuideFilter
from vtsdt.alignment.trips import Trip
from vtsdt.files.parameters import LiftParameters
from vtsdt.lift.lift import Lift

HERE = Path(__file__).parent


def drawn(model: FilterModel, noise: Noise, prior: Prior, times: np.ndarray, inputs: np.ndarray, seed: int) -> Any:
    """Return readings and truth of a machine that does what the filter assumes; inputs are held over a step."""
    rng = np.random.default_rng(seed)
    q, r = noise.of(model)
    mean, spread = prior.of(model)
    roots = np.sqrt(np.diag(spread)), np.sqrt(np.diag(q)), np.sqrt(r)
    z = mean + roots[0] * rng.standard_normal(model.n)
    system, n, step = model.system, len(model.system.states), float(times[1] - times[0])
    at = [system.index("parameter", each.state_names[0]) for each in model.latents]
    share = 1.0 if noise.kind == "per_step" else step
    outputs = [system.index("output", name) for name in model.measured]
    nominal, truth, readings = system.p.copy(), [], []
    for k in range(times.size):
        p = nominal.copy()
        if k:
            p[at] += z[n:]
            u = inputs[k - 1]
            k_1 = system.rhs(0.0, z[:n], u, p)
            k_2 = system.rhs(0.0, z[:n] + 0.5 * step * k_1, u, p)
            k_3 = system.rhs(0.0, z[:n] + 0.5 * step * k_2, u, p)
            k_4 = system.rhs(0.0, z[:n] + step * k_3, u, p)
            z = z.copy()
            z[:n] += step / 6.0 * (k_1 + 2.0 * (k_2 + k_3) + k_4)
            z += np.sqrt(share) * roots[1] * rng.standard_normal(model.n)
            p = nominal.copy()
        p[at] += z[n:]
        truth.append(z)
        readings.append(system.outputs_at(0.0, z[:n], inputs[k], p)[outputs] + roots[2] * rng.standard_normal(len(r)))
    return FilterSamples(times, inputs, np.array(readings)), np.array(truth)


def carriage() -> tuple[FilterModel, Noise, Prior, np.ndarray, np.ndarray]:
    """A mass on a spring whose stiffness wanders, pulled by a force; only its position is read."""
    from multibody import Model
    from multibody.library import ForceSource, Mass, Spring, ViscousFriction

    model = Model("carriage")
    body, spring = model.add("body", Mass(m=2.0)), model.add("spring", Spring(stiffness=80.0))
    guide, pull = model.add("guide", ViscousFriction(viscous=3.0)), model.add("pull", ForceSource())
    for part in (spring, guide):
        model.connect(part.a, model.ground)
        model.connect(part.b, body.flange)
    model.connect(pull.flange, body.flange)
    model.input("force", pull.force, default=0.0)
    system = model.build(outputs=["body.position"])
    joint = FilterModel(system, ["body.position"], [RandomWalk("spring.stiffness", std=8.0)])
    noise = Noise(
        {"body.position": 1e-9, "body.velocity": 1e-5, "spring.stiffness": 0.04}, {"body.position": 1e-8}, "per_step"
    )
    std = {"body.position": 2e-3, "body.velocity": 1e-2, "spring.stiffness": 8.0}
    times = np.arange(300) * 0.01
    return joint, noise, Prior({"body.position": 0.02}, std), times, (40.0 * np.sin(2.0 * times))[:, None] / 5.0


def cabin() -> tuple[FilterModel, Noise, Prior, np.ndarray, np.ndarray]:
    """The lift's cabin with δ, 12 + 1 states, going up with its shoes pressing: height and acceleration are read."""
    sensor = GuideFilter(parameters=LiftParameters.bench())
    run = Lift.reference(profile=False).trip("up", until=2.5, step=1e-3, rtol=1e-6, atol=1e-9)
    trip = Trip(name="up", time=run.times, tension=run["F_c"], height=run["z_c"], acceleration=run["zdd_c"])
    begun = int(np.argmax(trip.speed > 0.3))
    free, values = sensor.model(), dict(sensor.prior(trip).state)
    model = FilterModel(free.system, free.measured, free.latents)
    values |= {"cabin.z": float(run["z_c"][begun]), "cabin.v_z": float(trip.speed[begun]), DELTA: 2.2e-3}
    process = {n: 1e-10 if n.rpartition(".")[2] in ("x", "y", "z") else 1e-8 for n in sensor.system.state_names}
    noise = Noise({**process, DELTA: 1e-9}, {"z_c": 4e-10, "zdd_c": 1e-4}, "density_times_step")
    prior = Prior(values, {**dict.fromkeys(sensor.system.state_names, 1e-5), DELTA: 1e-4})
    return model, noise, prior, run.times[begun:] - run.times[begun], np.asarray(run["F_c"])[begun:, None]


def consistency_of(problem: Any, runs: int) -> tuple[Any, list[Any]]:
    """Return NEES over time and the tests of the innovations of independent runs."""
    model, noise, prior, times, inputs = problem
    estimates, truths = [], []
    for seed in range(runs):
        samples, truth = drawn(model, noise, prior, times, inputs, seed)
        estimates.append(extended_kalman_filter(model, samples, noise, prior, hold=True, keep="covariances"))
        truths.append(truth)
    return nees(estimates, truths), [run.consistency() for run in estimates]


def plot_consistency(path: Path) -> list[str]:
    """Draw NEES over time and NIS by run with their bounds, for two machines; return what they say."""
    figure, axes = plt.subplots(2, 2, figsize=(9, 5), layout="constrained", width_ratios=(2, 1))
    told = []
    problems = (("carriage, 2 + 1 states", carriage(), 40), ("lift's cabin with δ, 12 + 1 states", cabin(), 12))
    for (upper, lower), (name, problem, runs) in zip(axes, problems, strict=True):
        found, tests = consistency_of(problem, runs)
        upper.axhspan(*found.bounds, alpha=0.2, label="95 % if the assumptions hold")
        upper.plot(found.times, found.values, linewidth=0.8, label=f"mean of {runs} runs")
        upper.set_title(f"{name}: {found.inside:.0%} of the instants inside", fontsize="medium")
        upper.set_xlabel("time [s]")
        upper.set_ylabel("NEES by state [1]")
        inside = sum(t.nis_bounds[0] <= t.nis <= t.nis_bounds[1] for t in tests)
        lower.axhspan(*tests[0].nis_bounds, alpha=0.2)
        lower.plot(range(1, runs + 1), [t.nis for t in tests], ".")
        lower.set_title(f"{inside} of {runs} runs inside", fontsize="medium")
        lower.set_xlabel("run [1]")
        lower.set_ylabel("NIS by reading [1]")
        upper.legend(fontsize="small", loc="lower right")
        lower.xaxis.get_major_locator().set_params(integer=True)
        for axis in (upper, lower):
            axis.grid(alpha=0.3)
            middle = 1.0
            reach = max(abs(v - middle) for v in axis.get_ylim())
            axis.set_ylim(middle - reach, middle + reach)
        told.append(
            f"{name}: NEES inside {found.inside:.3f}, mean {found.values.mean():.3f}; NIS inside {inside}/{runs}, "
            f"mean {np.mean([t.nis for t in tests]):.3f}"
        )
    figure.savefig(path, dpi=90)
    plt.close(figure)
    return told


def plot_covariances(path: Path) -> list[str]:
    """Draw standard deviations along a trip of the lift: with the paper's sensors δ is bounded, two rails are not."""
    sensor = GuideFilter(parameters=LiftParameters.bench())
    run = Lift.reference().trip("up", step=1e-3, rtol=1e-5, atol=1e-8)
    trip = Trip(name="up", time=run.times, tension=run["F_c"], height=run["z_c"], acceleration=run["zdd_c"])
    one = sensor.run(trip)
    model = FilterModel(
        sensor.system,
        ["z_c", "zdd_c"],
        [
            RandomWalk(DELTA, name="right rail", rate=1e-6, std=2e-4),
            RandomWalk("cabin_guide.left_deviation", name="left rail", rate=1e-6, std=2e-4),
        ],
        parameters={DELTA: 2.0e-3},
    )
    prior = sensor.prior(trip)
    start = {k: v for k, v in dict(prior.state).items() if k != DELTA}
    both = extended_kalman_filter(
        model,
        one.samples,
        Noise({**dict.fromkeys(sensor.system.state_names, 1e-8)}, {"z_c": 1e-8, "zdd_c": 1e-2}),
        Prior(start, dict.fromkeys(start, 1e-4)),
        once=True,
    )
    figure, axes = plt.subplots(1, 3, figsize=(10.5, 3.2), layout="constrained")
    for name, label in ((DELTA, "δ"), ("cabin.z", "z")):
        axes[0].plot(one.times, 1e3 * one.std(name), label=label)
    for name in ("x", "y"):
        axes[1].plot(one.times, 1e3 * one.std(f"cabin.{name}"), label=f"{name} [mm]")
    for name in ("roll", "pitch", "yaw"):
        axes[1].plot(one.times, 1e3 * one.std(f"cabin.{name}"), "--", label=f"{name} [mrad]")
    for name in ("right rail", "left rail"):
        axes[2].plot(both.times, 1e3 * both.std(name), label=name)
    titles = ("one δ: what is measured or sought", "one δ: lateral states", "a δ for each rail: not detectable")
    for axis, title, unit in zip(axes, titles, ("mm", "mm, mrad", "mm"), strict=True):
        axis.set_title(title, fontsize="medium")
        axis.set_xlabel("time [s]")
        axis.set_ylabel(f"standard deviation [{unit}]")
        axis.set_ylim(bottom=0.0)
        axis.grid(alpha=0.3)
        axis.legend(fontsize="small")
    figure.savefig(path, dpi=90)
    plt.close(figure)
    early, late = (int(np.searchsorted(one.times, t)) for t in (2.0, 5.0))
    told = []
    for found, name in ((one, DELTA), (both, "right rail")):
        std = 1e3 * found.std(name)
        told.append(f"standard deviation of {name}: {std[early]:.3f} mm at 2 s, {std[late]:.3f} mm at 5 s")
    return told


def main() -> None:
    """Write all figures beside this file."""
    for line in (*plot_covariances(HERE / "filter-covariance.png"), *plot_consistency(HERE / "filter-consistency.png")):
        print(line)


if __name__ == "__main__":
    main()
