"""The state between the steps that a method has stored, for every compiled method."""

from __future__ import annotations

from multibody.compile.calls import entry, inner, pointer, shift
from multibody.solvers.kernels.dormand_prince import interpolate as by_seven_stages
from multibody.solvers.kernels.exponential import interpolate as by_both_ends
from multibody.solvers.kernels.rodas import interpolate_from as by_four_vectors
from multibody.solvers.kernels.stepping import step_of


@inner
def state_at(z, h, size, y, kept, k, out):
    """Write the state at the fraction z of a step; how many vectors it keeps tells whose it is."""
    if kept == 7:
        by_seven_stages(z, h, size, y, k, out)
    elif kept == 4:
        by_four_vectors(z, size, y, k, out)
    else:
        by_both_ends(z, h, size, y, k, out)


@entry
def interpolate_many(t, direction, steps, store_t, store_y, store_k, out):
    """Write the states at the times t, each in the stored step that holds it, into the rows of out.

    ``store_t`` (slots, 2) holds begin and size of each step, ``store_y`` (slots, size) the state at its begin and
    ``store_k`` (slots, 7, 4 or 3, size) what `DormandPrince54`, `Rodas5P` or `Exponential43` keep of it.
    """
    size, kept = out.shape[1], store_k.shape[1]
    spans, states, vectors, rows = pointer(store_t), pointer(store_y), pointer(store_k), pointer(out)
    j = 0
    for i in range(t.size):
        j = step_of(t[i], direction, steps, spans, j)
        h = spans[2 * j + 1]
        z = (t[i] - spans[2 * j]) / h
        state_at(z, h, size, shift(states, j * size), kept, shift(vectors, j * kept * size), shift(rows, i * size))
