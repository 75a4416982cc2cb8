"""An effect of a kind at a place, and how it is put into a model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import discrepancy.effects.built_in_kinds  # effects inside motors, tanks, … join the catalogue
import discrepancy.effects.stated_values  # noqa: F401 - values of controllers and circuits join the catalogue
from discrepancy.effects.kinds import Kind, kind_named
from discrepancy.effects.signal_errors import SignalLag, inserted
from discrepancy.effects.slip_of_transmissions import domain_of, slipping_class, with_slip
from multibody.base.spelling import nearest

if TYPE_CHECKING:
    from estimation.fit.calibrate import UncertainParameter
    from estimation.response.sensors import SensorError
    from multibody.assembly.places import Place
    from multibody.declare.component import Component
    from multibody.machine.model import Model, System

__all__ = ["Effect", "law_class", "unit_at"]

#: Share of the creep with which a fit begins, below which it does not go: the less a transmission slips, the stiffer is
#: the machine, and without any slip it is another one; chosen.
LEAST_SLIP = 1e-3
#: Shape parameters that are fitted within a factor of ten of where they begin.
POSITIVE = ("v_stribeck", "v_s", "width", "x_s", "order", "natural_frequency", "damping_ratio", "filter")


def law_class(kind: Kind, domain: str) -> type[Component]:
    """Return the component class of a connection kind for a domain."""
    from discrepancy.effects.laws import LAWS

    return LAWS[kind.law][0 if domain == "translation" else 1]


def _usual_shape(kind: Kind, domain: str, over: str) -> dict[str, float | None]:
    """Return the parameters of a law beside its strengths, with their usual values; None must be given."""
    if kind.free_form:
        return {"low": None, "high": None, **({"v_s": 1e-3} if over == "friction" else {})}
    from multibody.declare.declarations import Parameter

    declared = law_class(kind, domain).declarations  # type: ignore[attr-defined]
    return {k: q.default for k, q in declared.items() if isinstance(q, Parameter) and k not in kind.strengths}


@dataclass(frozen=True, kw_only=True)
class Effect:
    """An effect: kind, place, strengths and shape.

    Parameters
    ----------
    kind, where : str
        Such as ``"coulomb_friction"`` at ``"guide"``.
    strengths : mapping of str to float
        SI; all zero is absence.
    shape : mapping of str to float
        The law's other parameters.
    ports : tuple of str
        Endpoints of the two sides (connections).
    domain : str
        ``"translation"`` or ``"rotation"`` (connections, and the driven side of transmissions).
    load : str
        Output that gives the load or the temperature, where the law asks for one.
    number : int
        Counts effects of one kind at one place.
    over : str
        What a free curve is a function of.
    proposed : mapping of str to float
        Shape with which the effect was fitted first, which bounds every later one; empty before.
    """

    kind: str
    where: str
    strengths: Mapping[str, float] = field(default_factory=dict)
    shape: Mapping[str, float] = field(default_factory=dict)
    ports: tuple[str, ...] = ()
    domain: str = ""
    load: str = ""
    number: int = 1
    over: str = ""
    proposed: Mapping[str, float] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def at_place(cls, kind: str, place: Place, **parts: Any) -> Effect:
        """Return an effect at a place of a model.

        Strengths that are not given are zero (absence), and the law's other parameters those of its component: usual
        sizes for a machine of metres and seconds, so give them where the machine is smaller or slower.

        Parameters
        ----------
        kind : str
        place : Place
        **parts
            Fields of an effect: ``strengths``, ``shape``, ``load``, ``number``, ``over``, and ``where`` if it is not
            the name of the place.

        Raises
        ------
        KeyError
            If there is no such kind.
        ValueError
            If the kind acts on a sensor or an input, or has no strength or parameter of a given name; all faults.
        """
        definition = kind_named(kind).form(connection=True, strengths=parts.get("strengths", ()))
        if definition.at != "connection":
            what = {"sensor": "a sensor", "input": "an input"}.get(definition.at, f"a {definition.at}")
            raise ValueError(
                f"{kind} acts on {what}, not on a place: write "
                f"Effect(kind='{kind}', where='name of the signal', strengths={{'{definition.strengths[0]}': 0.0}})"
            )
        strengths, shape = dict(parts.pop("strengths", {})), dict(parts.pop("shape", {}))
        defaults = {k: 0.0 for k in definition.strengths}
        usual = _usual_shape(definition, place.domain, parts.get("over", ""))
        faults = [f"no strength '{k}'{nearest(k, defaults)}" for k in strengths if k not in defaults]
        faults += [f"no parameter '{k}'{nearest(k, usual)}" for k in shape if k not in usual]
        faults += [f"shape needs '{k}'" for k, v in usual.items() if v is None and k not in shape]
        if faults:
            raise ValueError(f"{kind} at '{place.name}': {'; '.join(faults)}")
        return cls(
            kind=kind,
            where=parts.pop("where", place.name),
            strengths={**defaults, **strengths},
            shape={**{k: v for k, v in usual.items() if v is not None}, **shape},
            ports=(place.first_port, place.second_port),
            domain=place.domain,
            **parts,
        )

    @property
    def definition(self) -> Kind:
        """The kind's entry in the catalogue."""
        return kind_named(self.kind).form(connection=bool(self.ports), strengths=self.strengths)

    @property
    def component_name(self) -> str:
        """Name of the component that carries the effect in a model (connections, lags of signals)."""
        return f"{self.kind}.{self.where}" + (f".n{self.number}" if self.number > 1 else "")

    def parameter_name(self, parameter: str) -> str:
        """Return the full name of one of the effect's parameters."""
        at = self.definition.at
        if at == "connection" or self.definition.inserted:
            return f"{self.component_name}.{parameter}"
        if at == "transmission":
            return f"{self.where}.{parameter}"
        if at == "parameter":
            owner, ending = self.definition.owner_of(self.where)
            return f"{owner}.{parameter}{ending}"
        return f"{at}.{self.where}.{parameter}"

    def parameters(self) -> dict[str, float]:
        """Return strengths and shape by their full names."""
        return {self.parameter_name(k): v for k, v in {**self.shape, **self.strengths}.items()}

    def unit(self, parameter: str) -> str:
        """Return the unit of one of the effect's parameters."""
        if self.definition.free_form:
            return str(law_class(self.definition, self.domain).declarations["curve"].unit)  # type: ignore[attr-defined]
        if self.definition.at == "parameter":
            ending = self.definition.owner_of(self.where)[1]
            own: Any = self.definition.component_class.declarations[f"{parameter}{ending}"]
            return "" if "{" in str(own.unit) else str(own.unit)  # that of a loop of any quantity is not known here
        if self.definition.at == "transmission":
            declared: Any = slipping_class(self.domain).declarations[parameter]  # type: ignore[attr-defined]
            return str(declared.unit)
        if self.definition.at == "connection":
            item: Any = law_class(self.definition, self.domain).declarations[parameter]
            return str(item.unit)
        return {"gain": "", "delay": "s", "lag": "s", "filter": "s", "offset": "", "drift": ""}[parameter]

    def usual_shape(self) -> dict[str, float]:
        """Return the law's parameters beside its strengths, at their usual values (connections)."""
        usual = _usual_shape(self.definition, self.domain, self.over)
        return {k: v for k, v in usual.items() if v is not None}

    def with_values(self, values: Mapping[str, float]) -> Effect:
        """Return the effect with parameters replaced, given by full name."""
        mine = {
            k: float(values[self.parameter_name(k)])
            for k in {**self.shape, **self.strengths}
            if self.parameter_name(k) in values
        }
        return replace(
            self,
            strengths={k: mine.get(k, v) for k, v in self.strengths.items()},
            shape={k: mine.get(k, v) for k, v in self.shape.items()},
            proposed=self.proposed or self.shape,
        )

    def added_to(self, model: Model) -> Model:
        """Return a copy of the model with the effect in it; sensor errors leave the model as it is."""
        kind = self.definition
        if kind.at == "sensor":
            return model
        if kind.inserted:
            lag = SignalLag(unit=_unit_of_signal(model, self.where), **self._given())
            return inserted(model, self.component_name, self.where, lag)
        if kind.at == "input":
            return model.with_input_error(self.where, **dict(self.strengths))
        if kind.at == "parameter":
            return model.with_values(self.parameters())
        if kind.at == "transmission":
            return with_slip(model, self.where, {**self.shape, **self.strengths})
        other = model.copy()
        cls = law_class(kind, self.domain)
        part = other.add(self.component_name, cls(**self._given()))
        other.connect(f"{self.component_name}.a", self.ports[0])
        if "b" in cls.declarations:
            other.connect(f"{self.component_name}.b", self.ports[1])
        if self.load:
            other.connect(self.load, getattr(part, kind.law_input))
        return other

    def _given(self) -> dict[str, Any]:
        """Return the values for the law's component."""
        if not self.definition.free_form:
            return {**self.shape, **self.strengths}
        y = tuple(self.strengths.values())
        return {"over": self.over, "curve": (self.knots, y), **{k: v for k, v in self.shape.items() if k == "v_s"}}

    @property
    def knots(self) -> tuple[float, ...]:
        """Arguments of the points of a free curve."""
        count = len(self.strengths)
        low, high = self.shape["low"], self.shape["high"]
        return tuple(low + (high - low) * k / (count - 1) for k in range(count))

    def sensor_error(self) -> SensorError | None:
        """Return the sensor's error, for sensor kinds."""
        from estimation.response.sensors import SensorError

        if self.definition.at != "sensor":
            return None
        name = self.definition.strengths[0]
        return SensorError(self.where, name, float(self.strengths.get(name, 0.0)))

    def uncertain(self, sizes: Mapping[str, float] | None = None) -> list[UncertainParameter]:
        """Return what calibration may move once the effect is in: strengths, and the shapes that may be fitted.

        A shape stays near that with which the effect was proposed, however often it is fitted: a speed below which dry
        friction fades that shrinks tenfold in every fit ends where no simulation feels it.
        """
        from estimation.fit.calibrate import UncertainParameter

        kind = self.definition
        parameters = []
        for name, value in self.strengths.items():
            low = 0.0 if kind.one_sided or (kind.stated and value > 0.0) else -math.inf
            if kind.at == "transmission":
                low = LEAST_SLIP * value
            high = 0.0 if kind.stated and value < 0.0 else math.inf
            parameters.append(
                UncertainParameter(name=self.parameter_name(name), value=value, min=low, max=high, unit=self.unit(name))
            )
        for name in kind.free_shapes:
            near = self.proposed.get(name, self.shape[name])
            reach = (sizes or {}).get(name, abs(near) if near else 1.0)
            low, high = (0.1 * near, 10.0 * near) if name in POSITIVE else (near - reach, near + reach)
            if name == "order":
                low, high = 0.9 * near, 1.1 * near
            value = min(max(self.shape[name], low), high)
            parameters.append(
                UncertainParameter(name=self.parameter_name(name), value=value, min=low, max=high, unit=self.unit(name))
            )
        return parameters

    def __str__(self) -> str:
        return f"{self.kind}@{self.where}"


def _unit_of_signal(model: Model, signal: str) -> str:
    """Return the unit of a model input or of a component's output."""
    if signal in model.inputs:
        signal = model.inputs[signal].targets[0]
    location = model.find(signal)
    assert location is not None
    declared: Any = location.component.declarations[location.item]
    return declared.unit or "1"


def unit_at(system: System, kind: str, where: str) -> str:
    """Return the unit of a kind's first strength at a place or signal of a machine.

    Parameters
    ----------
    system : System
    kind, where : str
    """
    entry = kind_named(kind)
    if entry.at == "connection":
        place = next((p for p in system.places if p.name == where), None)
        if place is None:  # the form of the kind that replaces a transmission
            domain = domain_of(system.model.components[where])
            return Effect(kind=kind, where=where, domain=domain).unit(entry.strengths[0])
        return Effect.at_place(kind, place).unit(entry.strengths[0])
    if entry.at == "parameter":
        return Effect(kind=kind, where=where).unit(entry.strengths[0])
    if entry.law in ("gain", "delay", "lag"):
        return "" if entry.law == "gain" else "s"
    signal = system.unit(where)
    return {"offset": signal, "drift": f"{signal}/s"}[entry.law]
