"""Sensitivities to the slip of rigid transmissions, by simulation with a small one.

Slip gives the machine a degree of freedom that the model does not have, so no force along the model's motion stands
for it.  The model with a transmission that creeps is simulated instead, and the change of the outputs is divided by the
creep.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.effects.effect import Effect
from discrepancy.effects.slip_of_transmissions import transmitted_by
from discrepancy.sensitivities.finite_amplitude import in_new_directions, outputs_of, parameters_for
from multibody.base.errors import SimulationError
from multibody.base.parallel import parallel_map

if TYPE_CHECKING:
    from discrepancy.effects.catalogue import Entry
    from discrepancy.sensitivities.linearised_problem import LinearisedProblem

__all__ = ["slip_sensitivities"]

#: Relative slips, at what is transmitted in the root mean square: from the creep of a good belt to a rope that glides;
#: chosen.
RELATIVE_SLIPS = (1e-3, 1e-2, 1e-1)


def slip_sensitivities(
    linearised: LinearisedProblem, entry: Entry
) -> list[tuple[dict[str, float], Sequence[np.ndarray]]]:
    """Return shapes with their ``amplitude``, and for each the sensitivity of every record, (n, n_channels, 1).

    Those whose sensitivity has the direction of that of a smaller creep are left out, and those that cannot be
    simulated.

    Parameters
    ----------
    linearised : LinearisedProblem
    entry : Entry
        Slip of a rigid transmission of its model.

    Raises
    ------
    ModelError
        If the machine with it cannot be built.
    """
    records = range(len(linearised.experiments))
    output = f"{entry.where}.{transmitted_by(linearised.system.model.components[entry.where])}"
    loads = np.concatenate([linearised.nominal_outputs(i)[output] for i in records])
    load = float(np.sqrt(np.mean(loads**2)))
    if not load > 0.0:
        return []
    amplitudes = [slip / load for slip in RELATIVE_SLIPS]
    effect = Effect(kind=entry.kind.name, where=entry.where, strengths={"creep": amplitudes[0]}, domain=entry.domain)
    system = effect.added_to(linearised.system.model).build(probes=True, outputs=linearised.experiments[0].outputs)
    base = parameters_for(linearised, system)
    rigid = parallel_map(lambda i: outputs_of(linearised, i, linearised.system, linearised.p), records)

    def sensitivity(k: int) -> list[np.ndarray] | None:
        p = base.copy()
        p[system.index("parameter", effect.parameter_name("creep"))] = amplitudes[k]
        try:
            changed = parallel_map(lambda i: outputs_of(linearised, i, system, p), records)
        except SimulationError:
            return None
        blocks = [linearised.weighted(i, (changed[i] - rigid[i])[:, :, None] / amplitudes[k]) for i in records]
        return blocks if all(np.all(np.isfinite(b)) for b in blocks) and any(np.any(b) for b in blocks) else None

    least = sensitivity(0)
    if least is None:
        return []
    found: list[tuple[int, Sequence[np.ndarray]]] = [(0, least)]
    others = in_new_directions(least, lambda k: sensitivity(k + 1), len(amplitudes) - 1, linearised.direction)
    found += [(k + 1, blocks) for k, blocks in others]
    fades = float(system.model.components[entry.where].values["v_s"])
    return [({"v_s": fades, "amplitude": amplitudes[k]}, blocks) for k, blocks in found]
