"""The gearbox paper equation by equation: where each stands in the code, and how far it is from the printed one.

Every equation is written here once more, with arrays alone, and held against the code at random points.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from discrepancy.validation.published import PaperChapter, PaperRow, claimed
from gearbox.papers.printed import PAPER

__all__ = ["equations_chapter"]

SEED, POINTS = 18, 80
#: Largest relative difference that rounding explains; solving for coefficients multiplies it by the condition.
EXACT, SOLVED = 1e-12, 1e-9

#: Where the print is at odds with itself or with mechanics, and what the code takes.
SLIPS = """| where | slip of the print | here |
| --- | --- | --- |
| Table 2 | K in N·s/m^(3/2) | N/mm^e_F |
| Eqs. 15 to 17 | the pitch radii give 8.82e5, the paper takes 8.6e5 | 8.6e5; the formula is offered |
| Table 5 | joint speeds are not 6 × the printed r/min in three of four rows | 6 × r/min |
| Eq. 11 | one mixed square for each pair, Eq. 18 has two | those of Eq. 18, 19 terms; Eq. 11's are `"eq11"` |
| Eq. 13 | e^(−γr) for the usual e^(−γr²); N(0, 1) less 0.5 drifts | e^(−γr), mean zero; the others are options |
| Eq. 18 | (t₁, t₂, t₃) = (K, C_D, e_F) contradicts Table 4 | the orders that fit are listed under Eq. 18 |
| Table 4 | the updated point is not the maximum of Eq. 18 | the maximum, 0.7607, is found and simulated |
"""


def equations_chapter() -> PaperChapter:
    """Return the chapter of Eqs. 1 to 20."""
    text = (
        "Largest relative difference between the equation, written once more with arrays alone, and the code, at "
        "random points. An agreement shows no more than that neither program has a slip.\n\n" + SLIPS
    )
    rows = (*_signals(), *_contact(), *_surface(), *_fireflies())
    return PaperChapter(paper=PAPER, place="Eqs. 1 to 20", title="equation by equation", rows=rows, text=text)


def _row(number: str, printed: str, place: str, difference: float, note: str = "", bar: float = EXACT) -> PaperRow:
    where = f"`{place}`" + (f"; {note}" if note else "")
    return claimed(number, printed, f"{difference:.1e}", difference, high=bar, bar=where)


def _apart(ours: object, theirs: object) -> float:
    a, b = np.asarray(ours, dtype=float), np.asarray(theirs, dtype=float)
    return float(np.abs(a - b).max() / max(np.abs(b).max(), 1e-300))


def _signals() -> Iterator[PaperRow]:
    from gearbox.files.operating_condition import OperatingCondition
    from gearbox.signals.mesh_lines import energy_share
    from gearbox.signals.signal import Signal
    from gearbox.signals.similarity import cosine

    rng, rate, count, mesh = np.random.default_rng(SEED), 10000.0, 4800, 1600.0 / 3.0
    t = np.arange(count) / rate
    sizes, phases = rng.uniform(0.5, 2.0, 8), rng.uniform(0.0, 2.0 * np.pi, 8)
    force = sum(
        a * np.cos(2.0 * np.pi * i * mesh * t + p) for i, (a, p) in enumerate(zip(sizes, phases, strict=True), start=1)
    )
    share = energy_share(Signal(force, rate, name="f"), mesh * np.arange(1, 9))
    yield _row(
        "Eqs. 1, 2",
        "f(t), y(t) = Σ a_i cos(2π i f_z t + θ_i)",
        "gearbox.signals.mesh_lines.energy_share",
        abs(share - 1.0),
        "all of such a signal stands at the mesh's multiples; of the simulated stage see Section 4.1",
        1e-6,
    )
    speeds = rng.uniform(500.0, 2000.0, POINTS)
    ours = [OperatingCondition(float(n), 100.0, "x").mesh_frequency(32) for n in speeds]
    yield _row("Eq. 3", "f_z = z₁ f_n1 = z₂ f_n2", "gearbox.files.OperatingCondition.mesh_frequency",
               max(_apart(ours, 32.0 * speeds / 60.0), _apart(ours, 44.0 * (speeds * 32.0 / 44.0) / 60.0)))  # fmt: skip
    a, b = rng.standard_normal((2, count))
    x, y = (Signal(v, rate, name=n) for v, n in ((a, "x"), (b, "y")))
    by_hand = float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))
    unit = a / np.linalg.norm(a) - b / np.linalg.norm(b)
    yield _row(
        "Eq. 7",
        "min ‖X_e − X_g‖²",
        "gearbox.signals.similarity.cosine",
        abs(float(unit @ unit) - 2.0 * (1.0 - cosine(x, y))),
        "of signals scaled to length one it is 2 (1 − cosine), so that Eqs. 7 and 8 have one optimum; of others the "
        "gain counts too, which the paper normalises away",
    )
    yield _row("Eq. 8", "R = X_e·X_g/(‖X_e‖ ‖X_g‖)", "gearbox.signals.similarity.cosine", abs(cosine(x, y) - by_hand))


def _contact() -> Iterator[PaperRow]:
    from gearbox.files.parameters import hertz_stiffness
    from gearbox.parts.contact_laws import impact

    rng = np.random.default_rng(SEED + 1)
    ours, theirs, forces, laws = [], [], [], []
    for _ in range(POINTS):
        r_1, r_2, modulus, nu = (
            float(rng.uniform(a, b)) for a, b in ((0.03, 0.1), (0.03, 0.1), (1e11, 3e11), (0.2, 0.4))
        )
        r_e, stiff = 1.0 / (1.0 / r_1 + 1.0 / r_2), 1.0 / (2.0 * (1.0 - nu**2) / modulus)
        ours.append(hertz_stiffness(r_1, r_2, modulus, nu))
        theirs.append(4.0 / 3.0 * np.sqrt(r_e) * stiff)
        depth, rate, e = float(rng.uniform(1e-6, 2e-4)), float(rng.uniform(-0.01, 0.05)), float(rng.uniform(1.5, 2.5))
        q = min(depth / 1e-4, 1.0)
        forces.append(impact(depth, rate, 8.6e5, e, 86e3, 1e-4)[0])
        laws.append(8.6e5 * (1e3 * depth) ** e + 86e3 * q * q * (3.0 - 2.0 * q) * rate)
    yield _row("Eqs. 15 to 17", "K = 4/3 √r_e E_e", "gearbox.files.parameters.hertz_stiffness", _apart(ours, theirs))
    yield _row(
        "Section 4.1", "K δ^e + step(δ; 0, 0, D_P, C_D) δ̇", "gearbox.parts.contact_laws.impact", _apart(forces, laws)
    )


def _surface() -> Iterator[PaperRow]:
    from gearbox.papers.eq_18_response_surface import EQ_18, eq_18
    from surrogate import DesignSpace, ResponseSurface, fit_response_surface, one_at_a_time, polynomial_terms

    rng, cube = np.random.default_rng(SEED + 2), DesignSpace.unit_cube(("t1", "t2", "t3"))
    points = rng.random((POINTS, 3))
    response = np.array([eq_18(tuple(map(float, t))) for t in points]) + 0.01 * rng.standard_normal(POINTS)
    fitted = fit_response_surface(cube, points, response, order=3)
    columns = np.array([np.prod(points ** np.array(powers), axis=1) for powers in EQ_18]).T
    beta = np.linalg.solve(columns.T @ columns, columns.T @ response)
    left = response - columns @ beta
    yield _row("Eqs. 4, 5", "Y = Xβ, β = (XᵀX)⁻¹XᵀY", "surrogate.fit_response_surface",
               _apart(fitted(points), columns @ beta), "solved by QR", SOLVED)  # fmt: skip
    r2 = 1.0 - float(left @ left) / float(((response - response.mean()) ** 2).sum())
    yield _row(
        "Eq. 6",
        "R² = 1 − Σ(y − ỹ)²/Σ(y − ȳ)²",
        "surrogate.ResponseSurface.quality",
        abs(fitted.quality.r2 - r2),
        "",
        SOLVED,
    )
    surface = ResponseSurface.from_coefficients(cube, list(EQ_18.values()))
    effects = one_at_a_time(surface, cube, levels=9, vectorised=True)
    swept = [
        np.ptp([eq_18(tuple(np.where(np.arange(3) == i, v, 0.5))) for v in np.linspace(0.0, 1.0, 9)]) for i in range(3)
    ]
    yield _row("Eqs. 9, 10", "S = ∂R/∂p_i, chosen p_s", "surrogate.one_at_a_time", _apart(effects.ranges, swept),
               "ranges over the bounds of Table 3 in place of derivatives, as Fig. 8 draws them")  # fmt: skip
    pairs = sum(1 for p in polynomial_terms(3, 3, "eq11").exponents if sorted(p) == [0, 1, 2])
    yield _row("Eq. 11 as printed", "Σ_(i>j) a_ijj p_i p_j²", "surrogate.polynomial_terms", abs(pairs - 3.0),
               "`\"eq11\"`: one mixed square a pair, as printed")  # fmt: skip
    values = [eq_18(tuple(map(float, t))) for t in points]
    yield _row(
        "Eq. 18", "19 coefficients", "surrogate.ResponseSurface.from_coefficients", _apart(surface(points), values)
    )
    low, high = np.array([4.3e5, 86e3, 1.5]), np.array([12.9e5, 860e3, 2.5])  # C_D in N·s/m
    from gearbox.rig.accelerometers import PARAMETERS

    ranges = {name: (a, b) for name, _, a, b, _ in PARAMETERS}
    ours = [ranges[name] for name in ("K", "C_D", "e_F")]
    yield _row(
        "Eq. 19",
        "bounds of K, C_D, e_F",
        "gearbox.rig.accelerometers.PARAMETERS",
        _apart(ours, np.array([low, high]).T),
    )


def _fireflies() -> Iterator[PaperRow]:
    from surrogate import DesignSpace, FireflySettings
    from surrogate.firefly import firefly_search
    from surrogate.objective import CountedObjective

    rng = np.random.default_rng(SEED + 3)
    seen: list[np.ndarray] = []

    def light(t: np.ndarray) -> np.ndarray:
        seen.append(np.array(t))
        return -((np.asarray(t) - 0.4) ** 2).sum(axis=1)

    settings = FireflySettings(population=2, iterations=1, beta0=0.7, gamma=1.0, alpha=0.0)
    firefly_search(CountedObjective(light, DesignSpace.unit_cube(("a", "b", "c")), 100, vectorised=True), settings, rng)
    first, second = (np.asarray(s).reshape(-1, 3) for s in (seen[0], seen[-1]))
    bright = int(np.argmax(-((first - 0.4) ** 2).sum(axis=1)))
    dim = 1 - bright
    away = first[bright] - first[dim]
    r = float(np.sqrt((away**2).sum()))
    moved = first[dim] + 0.7 * np.exp(-r) * away
    yield _row("Eqs. 13, 14", "p_i + β₀ e^(−γr) (p_j − p_i) + α(…)", "surrogate.firefly", _apart(second[dim], moved),
               "one move of two fireflies, α = 0")  # fmt: skip
    from gearbox.papers.eq_18_response_surface import EQ_18
    from surrogate import ResponseSurface, maximise

    cube = DesignSpace.unit_cube(("t1", "t2", "t3"))
    surface = ResponseSurface.from_coefficients(cube, list(EQ_18.values()))
    grid = np.linspace(0.0, 1.0, 101)
    best = float(surface(np.stack(np.meshgrid(grid, grid, grid), axis=-1).reshape(-1, 3)).max())
    maximum = maximise(surface, cube, seed=0).value
    yield _row(
        "Eqs. 12, 20",
        "max f, 0 ≤ t_i ≤ 1",
        "surrogate.maximise",
        max(best - maximum, 0.0),
        "against a grid of 101³ points",
    )
