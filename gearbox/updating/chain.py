"""The updating chain of the gearbox paper, section 3.4, steps 1 to 7, as one study.

Each step is a method and can be looked at by itself; :meth:`UpdatingChain.run` goes through all of them.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gearbox.signals.main_components import ACCEPTED_ERROR, main_components
from gearbox.signals.recordings import Recording
from gearbox.updating.checks import check_conditions, directions, pictured
from gearbox.updating.errors import UpdatingError
from gearbox.updating.identifiability import Identifiability
from gearbox.updating.objectives import AmplitudeObjective
from gearbox.updating.outcome import Candidate, FrequencyCheck, SurfaceChoice
from gearbox.updating.output_surfaces import OutputSurfaces, output_surface_study
from gearbox.updating.problem import UpdatingProblem
from gearbox.updating.result import UpdatingResult
from gearbox.updating.runs import Runs
from gearbox.updating.settings import UpdatingSettings
from gearbox.updating.virtual import Run
from multibody.base.progress import Progress, silent
from surrogate import (
    DesignSpace,
    OneAtATimeResult,
    OptimisationResult,
    ResponseSurface,
    SurrogateWarning,
    fit_response_surface,
    latin_hypercube,
    local_maxima,
    maximise,
    one_at_a_time,
    surface_study,
)

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["UpdatingChain"]

Array = NDArray[np.float64]
Surface = ResponseSurface | OutputSurfaces


class UpdatingChain(UpdatingProblem):
    """Update a gear stage model from recordings, step by step; parameters as of `UpdatingProblem`."""

    def __init__(
        self,
        settings: UpdatingSettings,
        runs: Runs,
        identify: Sequence[Recording],
        validate: Sequence[Recording] = (),
        *,
        progress: Progress = silent,
    ) -> None:
        super().__init__(settings, runs, identify, validate, progress=progress)
        self._made: list[Run] = []

    # ---------------------------------------------------------------- runs

    def _runs_at(self, rows: Sequence[Mapping[str, float]], what: str) -> list[list[Run]]:
        conditions = self.objective.conditions
        made = self.runs.many([({**self.settings.start, **row}, c) for row in rows for c in conditions], what)
        self._made += made
        return [made[i * len(conditions) : (i + 1) * len(conditions)] for i in range(len(rows))]

    def values_at(self, space: DesignSpace, points: Array, what: str) -> Array:
        """The objective at points, simulated, shape (n,); NaN where a simulation failed."""
        rows = [dict(zip(space.names, x, strict=True)) for x in np.atleast_2d(points).tolist()]
        return np.array([self.objective.value(runs) for runs in self._runs_at(rows, what)])

    # ---------------------------------------------------------------- steps

    def check_frequencies(self) -> FrequencyCheck:
        """Steps 1 and 2: run the model as it is, and compare its main components with theory.

        Raises
        ------
        UpdatingError
            If the relative error is above 5 %: then the model is wrong and no parameter will help.
        """
        base = self.identify[0]
        mesh = base.condition.mesh_frequency(self.settings.driving_teeth)
        rate = base.signal(self.settings.sensor).rate
        run = self.start_runs([base.condition])[0]
        duration = 0.5 if self.runs.settings.periodic else self.runs.settings.duration
        virtual = main_components(run.signal(self.settings.sensor, rate, duration), mesh)
        measured = main_components(base.signal(self.settings.sensor), mesh)
        assert base.nominal is not None
        check = FrequencyCheck(base.condition, base.nominal.speed_rpm, virtual, measured)
        if not check.accepted:
            raise UpdatingError(
                [
                    f"main components of the model are off theory by up to {100 * virtual.worst:.1f} % "
                    f"(limit {100 * ACCEPTED_ERROR:.0f} %): check tooth numbers, speed and contact of the model before "
                    "updating its parameters"
                ]
            )
        if not measured.accepted:
            self.notes.append(
                f"Main components of the measurement are up to {100 * measured.worst:.1f} % off multiples of the mesh "
                "frequency: something other than the mesh is among its strongest lines."
            )
        return check

    def sensitivity(self) -> tuple[OneAtATimeResult, tuple[str, ...]]:
        """Step 5: move one parameter at a time, and keep those that matter (Eqs. 9 and 10)."""
        s = self.settings

        def f(points: Array) -> Array:
            return self.values_at(s.space, points, "sensitivity")

        result = one_at_a_time(f, s.space, base=s.start, levels=s.levels, vectorised=True)
        selected = s.keep or result.select(s.share)[: s.most]
        return result, tuple(n for n in s.space.names if n in selected)

    def surfaces(self, space: DesignSpace) -> tuple[SurfaceChoice, list[tuple[Array, Array]]]:
        """Step 6: designs of several sizes, surfaces of several orders, and the one that predicts best.

        The surface is chosen by its leave-one-out R², so that the test points judge it without having chosen it.
        Amplitudes and phases get a surface each; the cosine similarity is a surface itself, as in the paper.
        """
        s = self.settings
        rng = np.random.default_rng([s.seed, 6])
        sizes = sorted(set(s.points))
        designs = [latin_hypercube(space, n, optimisation="none", seed=rng).points for n in sizes]
        unseen = latin_hypercube(space, s.test, optimisation="none", seed=rng).points
        failed = 0

        def simulated(points: Array, what: str) -> tuple[Array, Array, list[list[Run]]]:
            nonlocal failed
            rows = [dict(zip(space.names, x, strict=True)) for x in points.tolist()]
            made = self._runs_at(rows, what)
            y = np.array([self.objective.value(runs) for runs in made])
            good = np.isfinite(y)
            failed += int((~good).sum())
            return points[good], y[good], [runs for runs, ok in zip(made, good, strict=True) if ok]

        test = simulated(unseen, f"{s.test} test points")
        done = [simulated(x, f"design of {len(x)} points") for x in designs]
        if len(test[1]) < 2 or np.ptp(test[1]) == 0.0:
            raise UpdatingError(["the objective does not vary over the test points: no surface can be judged"])
        fitted: dict[tuple[int, int], Surface] = {}
        if isinstance(self.objective, AmplitudeObjective):
            of_runs = self.objective.of_runs
            tables = [(x, np.array([of_runs(r) for r in made])) for x, _, made in done]
            kept = (test[0], np.array([of_runs(r) for r in test[2]]))
            study, outputs = output_surface_study(self.objective, space, tables, kept, s.surface_orders)
            fitted |= outputs
        else:
            pairs = [(x, y) for x, y, _ in done]
            study = surface_study(space, pairs, (test[0], test[1]), orders=s.surface_orders)
        usable = study[study["r2_loo"].notna()] if "r2_loo" in study else study.iloc[:0]
        if usable.empty:
            raise UpdatingError(
                [f"no surface can be fitted: {note}" for note in dict.fromkeys(study["note"]) if note]
                or ["no surface can be fitted"]
            )
        row = usable.loc[usable["r2_loo"].idxmax()]
        points, order = int(row["points"]), int(row["order"])
        if (points, order) not in fitted:
            x, y, _ = next(d for d in done if len(d[1]) == points)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", SurrogateWarning)
                fitted[points, order] = fit_response_surface(
                    space,
                    x,
                    y,
                    order=order,
                    test=(test[0], test[1]),
                    response=self.objective.name,
                    limits=(-1.0, 1.0) if s.objective == "similarity" else None,  # a cosine
                )
        if float(row["test_r2"]) < 0.5:
            self.notes.append(
                f"The surface explains only {100 * max(float(row['test_r2']), 0.0):.0f} % of the variance at points it "
                "has not seen; its optimum is only a guess, which the simulation checks."
            )
        choice = SurfaceChoice(study=study, surface=fitted[points, order], points=points, order=order, failed=failed)
        return choice, [(x, y) for x, y, _ in [*done, test]]

    def search(self, choice: SurfaceChoice) -> tuple[OptimisationResult, pd.DataFrame]:
        """Step 7: the surface's maximum by fireflies with a local polish, and its rivals."""
        s = self.settings
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", SurrogateWarning)
            best = maximise(
                choice.surface,
                choice.surface.space,
                method=s.method,
                options=s.options,
                seed=np.random.default_rng([s.seed, 7]),
            )
        self.notes += [f"{str(w.message)[:1].upper()}{str(w.message)[1:]}." for w in caught]
        return best, local_maxima(
            choice.surface, choice.surface.space, starts=30, seed=np.random.default_rng([s.seed, 8])
        )

    def candidate(self, origin: str, values: Mapping[str, float], predicted: float = float("nan")) -> Candidate:
        """Simulate a set of parameters and judge it."""
        row = {**self.settings.start, **values}
        value = self.objective.value(self._runs_at([row], "candidate")[0])
        run = self.runs.one(row, self.similarity.conditions[0])
        return Candidate(
            origin=origin,
            values=row,
            predicted=predicted,
            simulated=value,
            similarity=None if run.failed else self.similarity.similarity(run),
        )

    # ---------------------------------------------------------------- all of it

    def run(self) -> UpdatingResult:
        """Go through all steps.

        Raises
        ------
        UpdatingError
            Where a step cannot be done; what was simulated until then is kept in the store.
        """
        s = self.settings
        self.progress("step 2: frequencies of the model as it is")
        frequencies = self.check_frequencies()
        start = self.candidate("the model as it is", s.start)
        self.progress("step 5: sensitivity")
        sensitivity, selected = self.sensitivity()
        if not selected:
            raise UpdatingError(["no parameter moves the objective: check that the model uses them"])
        space = s.space.subset(selected)
        self.progress(f"step 6: surfaces of {', '.join(selected)}")
        choice, designs = self.surfaces(space)
        self.progress("step 7: search on the surface")
        best, rivals = self.search(choice)
        optimum = self.candidate("the optimum of the surface", best.parameters, best.value)
        tried = [start, optimum, *self._others(space, designs, rivals, optimum)]
        updated = self._taken(start, optimum, tried)
        if optimum.predicted > 1.0:
            self.notes.append(
                f"The surface predicts {optimum.predicted:.3f}, but no value exceeds 1: near its optimum it is "
                "wrong by at least that much."
            )
        if best.at_bound:
            self.notes.append(
                f"The surface's optimum has {', '.join(best.at_bound)} at the edge of the range: the best may lie "
                "outside."
            )
        self.progress("other operating conditions")
        checks = check_conditions(self, updated.values)
        information: tuple[Identifiability, ...] = ()
        if s.identify:
            self.progress("identifiable directions")
            information = directions(self, space, updated.values)
        self._note_bound(updated)
        return UpdatingResult(
            settings=s,
            frequencies=frequencies,
            sensitivity=sensitivity,
            selected=selected,
            choice=choice,
            search=best,
            rivals=rivals,
            start=start,
            optimum=optimum,
            updated=updated,
            tried=tuple(tried),
            checks=checks,
            directions=information,
            off_mesh=max((r.off_mesh for r in self._made if not r.failed), default=0.0),
            simulations=self.runs.done,
            reused=self.runs.reused,
            failed=len({self.runs.key(r.values, r.condition) for r in self._made if r.failed}),
            seconds=self.runs.seconds,
            notes=tuple(dict.fromkeys(self.notes)),
            pictures=pictured(self, start, updated),
        )

    def _others(
        self, space: DesignSpace, designs: Sequence[tuple[Array, Array]], rivals: pd.DataFrame, optimum: Candidate
    ) -> list[Candidate]:
        """The best simulated design point and the surface's next hill: candidates that cost next to nothing."""
        others = []
        for _, row in rivals.head(3).iterrows():
            values = {n: float(row[label]) for n, label in zip(space.names, space.labels(), strict=True)}
            away = space.to_unit([[values[n] for n in space.names]]) - space.to_unit(
                [[optimum.values[n] for n in space.names]]
            )
            if np.abs(away).max() > 0.02:
                others.append(self.candidate("another hill of the surface", values, float(row["value"])))
        points, values_there = (np.concatenate([d[i] for d in designs]) for i in (0, 1))
        top = int(np.argmax(values_there))
        others.append(
            self.candidate("the best point of the designs", dict(zip(space.names, points[top].tolist(), strict=True)))
        )
        return others

    def _taken(self, start: Candidate, optimum: Candidate, tried: Sequence[Candidate]) -> Candidate:
        """The surface's optimum if it is better than the start, as in the paper; else the best that was simulated."""
        if optimum.simulated > start.simulated:
            better = [c for c in tried if c.simulated > optimum.simulated + 1e-4]
            if better:
                top = max(better, key=lambda c: c.simulated)
                self.notes.append(
                    f"{top.origin[0].upper()}{top.origin[1:]} was simulated at {top.simulated:.4f}, above the "
                    f"surface's optimum at {optimum.simulated:.4f}, and is taken."
                )
                return top
            return optimum
        good = [c for c in tried if np.isfinite(c.simulated)]
        return max(good, key=lambda c: c.simulated)

    def _note_bound(self, updated: Candidate) -> None:
        score = updated.similarity
        if score is None:
            return
        self.notes.append(
            f"Mesh lines hold {100 * score.mesh_share:.1f} % of the measured signal's energy in the band, so that no "
            f"healthy model can reach a cosine similarity above {score.bound:.3f}."
        )
        self.notes.append(
            f"Among all lags within ±{1e3 * score.max_lag:.2f} ms the cosine runs from {score.lowest:.2f} to its "
            f"highest; {100 * score.share_above:.0f} % of them give more than 0.6. The lag is part of the score."
        )
