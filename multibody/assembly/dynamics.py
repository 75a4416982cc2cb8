"""Newton's law for the assembled machine: mass matrix block by block, accelerations, reactions.

Every inertia contributes rows ``v_row = Σ_j J_j v_j (+ …)`` over the independent coordinates ``j``.  Then
``M_ij = Σ J_i m J_j`` and ``F_i = Σ J_i (f − m b)``, with ``b`` the acceleration at constant independent speeds.
Coordinates that do not influence each other are solved separately, so that a machine of separate bodies needs no
matrix.
"""

from __future__ import annotations

from multibody.assembly.equation_set import Assembly, Contribution, Coordinate, Unknown

__all__ = ["accelerations", "product", "total"]

#: Of a sum in one row.  Python reads and writes a row of sums one inside the other, about three calls for each, and has
#: a thousand.
MOST_TERMS = 64


def product(*factors: str) -> str:
    """Return the text of a product, ones left out.

    Examples
    --------
    >>> product("1.0", "m", "J")
    'm * J'
    """
    texts = [f if f.replace(".", "").replace("_", "").isalnum() else f"({f})" for f in factors if f != "1.0"]
    return " * ".join(texts) or "1.0"


def total(terms: list[str]) -> str:
    """Return the text of a sum; one of very many terms as a sum of sums, which can be read at any length.

    Examples
    --------
    >>> total(["a", "-b"]), total([])
    ('a + -b', '0.0')
    """
    while len(terms) > MOST_TERMS:
        terms = [f"({' + '.join(terms[k : k + MOST_TERMS])})" for k in range(0, len(terms), MOST_TERMS)]
    return " + ".join(terms) or "0.0"


def accelerations(work: Assembly) -> None:
    """Add the statements of every coordinate's acceleration and every prescribed coordinate's reaction."""
    matrix: dict[tuple[str, str], list[str]] = {}
    force: dict[str, list[str]] = {c.key: [] for c in work.coordinates}
    for part in work.contributions:
        _collect(part, matrix, force)
    massless = {c.key for c in work.coordinates if c.kind == "free" and (c.key, c.key) not in matrix}
    for c in work.coordinates:
        work.add(f"{c.key}___F = {total(force[c.key])}", c.name)
    for (i, j), terms in matrix.items():
        if i <= j:
            work.add(f"{_entry(i, j)} = {total(terms)}", f"mass of {i}")
    free = [c for c in work.coordinates if c.kind == "free" and c.key not in massless]
    prescribed = [c for c in work.coordinates if c.kind == "prescribed"]
    for block in _blocks([c.key for c in free], matrix):
        members = [c for c in free if c.key in block]
        right = []
        for c in members:
            terms = [f"{c.key}___F"]
            terms += [f"-{_entry(c.key, g.key)} * {g.acceleration}" for g in prescribed if (c.key, g.key) in matrix]
            right.append(total(terms))
        _solve(work, members, right, matrix)
    for g in prescribed:
        if g.reaction:
            inertia = [
                f"{_entry(g.key, c.key)} * {c.acceleration}" for c in (*free, *prescribed) if (g.key, c.key) in matrix
            ]
            work.add(f"{g.reaction} = {total(inertia)} - {g.key}___F", g.name)
    for c in work.coordinates:
        if c.key in massless:  # no mass: the speed is what makes the forces balance
            work.unknowns.append(Unknown(c.name, c.velocity, f"{c.key}___F"))


def _collect(part: Contribution, matrix: dict[tuple[str, str], list[str]], force: dict[str, list[str]]) -> None:
    n = len(part.rows)
    for r in range(n):
        for i, j_i in part.rows[r].items():
            if part.force and part.force[r] is not None:
                force[i].append(product(j_i, part.force[r] or ""))
            for s in range(n):
                m = part.mass.get((r, s))
                if m is None:
                    continue
                if part.bias and part.bias[s] is not None:
                    force[i].append(f"-{product(j_i, m, part.bias[s] or '')}")
                for j, j_j in part.rows[s].items():
                    matrix.setdefault((i, j), []).append(product(j_i, m, j_j))


def _entry(i: str, j: str) -> str:
    return f"_M__{min(i, j)}___{max(i, j)}"


def _blocks(keys: list[str], matrix: dict[tuple[str, str], list[str]]) -> list[set[str]]:
    left, blocks = list(keys), []
    while left:
        block, stack = set(), [left[0]]
        while stack:
            key = stack.pop()
            if key not in block:
                block.add(key)
                stack += [k for k in left if (key, k) in matrix and k not in block]
        left = [k for k in left if k not in block]
        blocks.append(block)
    return blocks


def _solve(
    work: Assembly, members: list[Coordinate], right: list[str], matrix: dict[tuple[str, str], list[str]]
) -> None:
    """Write the solution of a symmetric positive definite block: division, or LDLᵀ written out."""
    origin = ", ".join(c.name for c in members)
    if len(members) == 1:
        c = members[0]
        top = right[0] if right[0] == f"{c.key}___F" else f"({right[0]})"
        work.add(f"{c.acceleration} = {top} / {_entry(c.key, c.key)}", origin)
        return
    n = len(members)
    keys = [c.key for c in members]
    base = f"_S__{keys[0]}_"
    present = [[(keys[i], keys[j]) in matrix for j in range(n)] for i in range(n)]
    low = [[False] * n for _ in range(n)]
    for i in range(n):  # U = L D is stored as well as L, and one division for each row gives 1/D
        for j in range(i + 1):
            terms = [f"{base}__L_{i}_{k} * {base}__U_{j}_{k}" for k in range(j) if low[i][k] and low[j][k]]
            start = _entry(keys[i], keys[j]) if present[i][j] else "0.0"
            text = f"{start} - ({total(terms)})" if terms else start
            if i == j:
                work.add(f"{base}__E_{i} = 1.0 / ({text})", origin)
            elif present[i][j] or terms:
                low[i][j] = True
                work.add(f"{base}__U_{i}_{j} = {text}", origin)
                work.add(f"{base}__L_{i}_{j} = {base}__U_{i}_{j} * {base}__E_{j}", origin)
    for i in range(n):
        known = "".join(f" - {base}__L_{i}_{k} * {base}__y_{k}" for k in range(i) if low[i][k])
        work.add(f"{base}__y_{i} = {right[i]}{known}", origin)
    for i in reversed(range(n)):
        later = [k for k in range(i + 1, n) if low[k][i]]
        known = "".join(f" - {base}__L_{k}_{i} * {members[k].acceleration}" for k in later)
        work.add(f"{members[i].acceleration} = {base}__y_{i} * {base}__E_{i}{known}", origin)
