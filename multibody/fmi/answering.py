"""A foreign unit in Model Exchange, inside its own process: one instance, and the question that equations put to it.

The question is compiled where equations are, and calls the unit's functions without a turn of Python.  What it needs to
know stands in a table of numbers and addresses; what is rare (other parameters) is called back.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from multibody.base.cache import digest_of
from multibody.compile.settings import jit_enabled
from multibody.fmi.errors import FmuError
from multibody.fmi.foreign_description import ForeignUnit, ForeignVariable
from multibody.fmi.stepping import references, values_of

__all__ = ["OUTPUTS", "RATES", "SLOPES", "VERSION", "Answer", "RunningUnit", "running"]

#: Stands in every text of equations that ask a unit: machine code is kept by its text, and has the question in it.
VERSION = digest_of(Path(__file__).read_text(encoding="utf-8"))

#: What a question asks for, added up: rates, outputs, and the derivatives of what is asked for along a direction.
RATES, OUTPUTS, SLOPES = 1, 2, 4

_STEP = float(np.finfo(float).eps) ** (1 / 3)  # relative step of central differences: truncation against rounding
_WARNING, _DISCARD = 1, 2  # states of both versions of the standard

# Of the table first numbers: the instance; how many numbers make a point (time, states, inputs, parameters), how many
# of them are states, inputs and outputs, of how many derivatives are exact; what is known at the point, whether the
# unit is at it, whether it works now, how many questions it has had, the status of its first error;
COMPONENT, SIZE, STATES, INPUTS, OUTS, EXACT, HAVE, THERE, BUSY, COUNT, FAULT = range(11)
# then addresses of float64: the point in SI and in the unit's own numbers, factors and offsets between them, sizes for
# differences, parameters that the unit has, results in its own numbers and in SI's factors, a direction, the result
# along it, columns of the Jacobian, and which of them are known;
GIVEN, NOW, FACTOR, OFFSET, NOMINAL, PARAMETERS, RESULT, OUT_FACTOR, OUT_OFFSET, ALONG, SLOPE, COLUMNS, KNOWN = range(
    11, 24
)
# and of value references, with their number: of inputs, of outputs, of rates and outputs, of what is differentiated by.
IN_REF, N_IN, OUT_REF, N_OUT, UNKNOWN_REF, N_RATES, KNOWN_REF, N_KNOWN = range(24, 32)
# And again of float64: room for what is given, and for the answers to the questions of a text; and of the question.
# Last, whether the instance is initialised.
ROOM, ANSWERS, QUESTION, STARTED = range(32, 36)
FIELDS = 36

#: Where the table is to stand in every process of a unit: far from where systems put things by themselves.
_TABLE_AT = 0x5A0000000000

_running: RunningUnit | None = None


def running() -> RunningUnit | None:
    """Return the unit that runs in this process, if it is a unit's own."""
    return _running


class Answer(float):
    """What stands for an answer in equations that are plain Python; in compiled ones it is a number without meaning."""

    values: np.ndarray

    def __new__(cls, values: np.ndarray) -> Answer:
        """Return what stands for these values."""
        answer = super().__new__(cls, 0.0)
        answer.values = values
        return answer

    def shown(self, place: int, k: int) -> float:
        """Return a value."""
        return float(self.values[k])

    def slope_shown(self, place: int, k: int, count: int) -> float:
        """Return the derivative of a value."""
        return float(self.values[count + k])


class RunningUnit:
    """One instance of a unit, in continuous-time mode between questions; a process has one.

    Parameters
    ----------
    unit : ForeignUnit
    folder : str
        Where its files are unpacked.

    Attributes
    ----------
    table : ndarray of int64
        For compiled code.
    """

    def __init__(self, unit: ForeignUnit, folder: str) -> None:
        import fmpy

        global _running
        self.unit = unit
        fmpy.extract(str(unit.path), folder)
        described = fmpy.read_model_description(folder, validate=False)
        self.fmu: Any = fmpy.instantiate_fmu(folder, described, fmi_type="ModelExchange")
        self.second = unit.fmi_version == "2.0"
        known = (*unit.states, *unit.inputs, *unit.parameters)
        n, n_u, n_y = len(unit.states), len(unit.inputs), len(unit.outputs)
        self.first_parameter, size, count = 1 + n + n_u, 1 + len(known), n + n_y
        # of how many of what is known, from the first state on, the unit gives derivatives itself
        exact = len(known) if unit.exact_parameters else n + n_u if unit.derivatives else 0
        groups = (unit.states, unit.inputs, unit.parameters) if unit.exact_parameters else (unit.states, unit.inputs)
        factor, offset = _scales(known, 1)
        out_factor, out_offset = _scales(unit.outputs, n)
        out_factor[:n] = [v.factor for v in unit.states]
        self.now = np.full(size, np.nan)
        self.parameters = np.full(len(unit.parameters), np.nan)
        self.fresh = True
        self.error: BaseException | None = None
        floats = {
            GIVEN: np.full(size, np.nan),
            NOW: self.now,
            FACTOR: factor,
            OFFSET: offset,
            NOMINAL: np.array([1.0, *(abs((v.start - v.offset) / v.factor) or 1.0 for v in known)]),
            PARAMETERS: self.parameters,
            RESULT: np.zeros(count),
            OUT_FACTOR: out_factor,
            OUT_OFFSET: out_offset,
            ALONG: np.zeros(size),
            SLOPE: np.zeros(count),
            COLUMNS: np.zeros((size, count)),
            KNOWN: np.zeros(size),
            ROOM: np.zeros(2 * size),
            ANSWERS: np.zeros((2 + n_y, 2 * count)),  # a question of rates, and at most one for each output
        }
        of_inputs, of_outputs = references(unit.inputs), references(unit.outputs)
        of_known = [r for g in groups for r in references(g)]
        lists = {
            IN_REF: np.array([*of_inputs, 0], dtype=np.uint32),
            OUT_REF: np.array([*of_outputs, 0], dtype=np.uint32),
            UNKNOWN_REF: np.array([*unit.rates, *of_outputs, 0], dtype=np.uint32),
            KNOWN_REF: np.array([*of_known, 0], dtype=np.uint32),
        }
        self.address = _reserved(8 * FIELDS)
        self.table = np.ctypeslib.as_array((ctypes.c_int64 * FIELDS).from_address(self.address))
        component = self.fmu.component
        self.table[: EXACT + 1] = int(getattr(component, "value", component) or 0), size, n, n_u, n_y, exact
        self.table[N_IN], self.table[N_OUT] = len(of_inputs), len(of_outputs)
        self.table[N_RATES], self.table[N_KNOWN] = len(unit.rates), len(of_known)
        for place, array in (floats | lists).items():
            self.table[place] = array.ctypes.data
        self._arrays = floats, lists
        self._moved = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)(self._take_parameters)
        _running = self

    @cached_property
    def _question(self) -> Callable[[int, np.ndarray, np.ndarray], None]:
        return _question(self)

    def prepare(self) -> None:
        """Compile the question, which equations reach by the table."""
        _ = self._question

    def ask(self, key: int, wanted: int, place: int, given: np.ndarray) -> Answer:
        """Return an answer to equations that are plain Python; see `multibody.fmi.asking`."""
        values = np.zeros(2 * int(self.table[STATES] + self.table[OUTS]))
        self._question(wanted, given, values)
        return Answer(values)

    def answer(self, numbers: np.ndarray) -> np.ndarray:
        """Return what is asked for (the first number) at a point, which a direction may follow."""
        values = self.ask(0, int(numbers[0]), 0, np.array(numbers[1:])).values
        self.check()
        return values

    def check(self) -> None:
        """Raise what has gone wrong since the last time.

        Raises
        ------
        FmuError
            If the unit has answered with an error.
        """
        error, self.error = self.error, None
        status, self.table[FAULT] = int(self.table[FAULT]), 0
        if error is not None:
            raise error
        if status:
            raise FmuError(f"it answers with status {status} ({'error' if status == _DISCARD + 1 else 'fatal'})")

    def start(self, numbers: np.ndarray) -> np.ndarray:
        """Return the states after the unit's own initialization with these parameters, in the unit's numbers."""
        self.now[self.first_parameter :] = numbers
        self.table[THERE], self.table[BUSY] = 0, 1
        self._start()
        self.table[BUSY] = 0
        return values_of(self.fmu, references(self.unit.states), len(self.unit.states))

    def _take_parameters(self, _: int) -> int:
        """Give the unit the parameters that now count; called back by the question, 0 says that it has failed."""
        try:
            wanted = self.now[self.first_parameter :]
            changed = np.flatnonzero(wanted != self.parameters).tolist()
            if self.fresh or any(not self.unit.parameters[k].tunable for k in changed):
                self._start()
            else:
                self.fmu.enterEventMode()
                moved = {self.unit.parameters[k].reference for k in changed}  # an array is set as a whole
                chosen = [k for k, v in enumerate(self.unit.parameters) if v.reference in moved]
                self._set(references([self.unit.parameters[k] for k in chosen]), wanted[chosen])
                self._settle()
                self.parameters[:] = wanted
        except BaseException as error:
            self.error = error
            return 0
        return 1

    def _start(self) -> None:
        """Initialise the instance with the parameters that now count."""
        fmu, wanted = self.fmu, self.now[self.first_parameter :]
        if not self.fresh:
            fmu.reset()
        self.fresh = False
        if self.second:
            fmu.setupExperiment(startTime=0.0)
        self._set(references(self.unit.parameters), wanted)
        if self.second:
            fmu.enterInitializationMode()
        else:
            fmu.enterInitializationMode(startTime=0.0)
        fmu.exitInitializationMode()
        self._settle()
        self.parameters[:] = wanted
        self.table[STARTED] = 1

    def _settle(self) -> None:
        """Leave event mode for continuous time."""
        again = True
        while again:
            again = (self.fmu.newDiscreteStates if self.second else self.fmu.updateDiscreteStates)()[0]
        self.fmu.enterContinuousTimeMode()

    def _set(self, which: list[int], values: np.ndarray) -> None:
        if which:
            (self.fmu.setReal if self.second else self.fmu.setFloat64)(which, values.tolist())

    def functions(self) -> dict[str, tuple[Any, tuple[Any, ...]]]:
        """Return the unit's functions that a question calls, with the kinds of their arguments, by our own names."""
        whole, real, second = ctypes.c_int64, ctypes.c_double, self.second
        names = {
            "set_time": ("SetTime", (whole, real)),
            "set_states": ("SetContinuousStates", (whole,) * 3),
            "set_values": ("SetReal" if second else "SetFloat64", (whole,) * (4 if second else 5)),
            "get_values": ("GetReal" if second else "GetFloat64", (whole,) * (4 if second else 5)),
            "get_rates": ("GetDerivatives" if second else "GetContinuousStateDerivatives", (whole,) * 3),
        }
        if self.unit.derivatives:
            names["directional"] = ("GetDirectionalDerivative", (whole,) * (7 if second else 9))
        prefix, functions = "fmi2" if second else "fmi3", {}
        for own, (name, arguments) in names.items():
            try:
                address = ctypes.cast(self.fmu.dll[f"{prefix}{name}"], ctypes.c_void_p).value
            except AttributeError as error:
                raise FmuError(f"its library has no function {prefix}{name}") from error
            functions[own] = ctypes.CFUNCTYPE(ctypes.c_int32, *arguments)(address or 0), arguments
        return functions


def _scales(variables: tuple[ForeignVariable, ...], before: int) -> tuple[np.ndarray, np.ndarray]:
    """Return factors and offsets of variables that stand behind some numbers in SI."""
    factor, offset = np.ones(before + len(variables)), np.zeros(before + len(variables))
    factor[before:], offset[before:] = [v.factor for v in variables], [v.offset for v in variables]
    return factor, offset


def _reserved(size: int) -> int:
    """Return the address of zeros that stay; the same in every process, where the place is free."""
    import mmap

    call = ctypes.CDLL(None).mmap
    call.restype = ctypes.c_void_p
    call.argtypes = [ctypes.c_void_p, ctypes.c_size_t, *[ctypes.c_int] * 3, ctypes.c_long]
    kind = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS
    address = call(_TABLE_AT, size, mmap.PROT_READ | mmap.PROT_WRITE, kind, -1, 0)
    if address in (None, ctypes.c_void_p(-1).value):
        raise MemoryError("there is no memory for the table of a unit")
    return int(address)


def _question(unit: RunningUnit) -> Callable[[int, np.ndarray, np.ndarray], None]:
    """Return the question, compiled, or the same in Python where nothing is."""
    functions = unit.functions()
    if not jit_enabled():

        def array_at(address: int, count: int) -> np.ndarray:
            return np.ctypeslib.as_array((ctypes.c_double * int(count)).from_address(int(address)))

        def plain(function: Any) -> Any:
            return lambda *given: int(function(*(g if isinstance(g, float) else int(g) for g in given)))

        called = {name: plain(function) for name, (function, _) in functions.items()}
        return _written(lambda f: f, unit.second, lambda: unit.table, array_at, unit._moved, **called)

    from llvmlite import binding
    from numba import carray, njit, types
    from numba.extending import intrinsic

    from multibody.compile.emitter.machine import compiled, loaded
    from multibody.compile.numba_functions import address_of_function
    from multibody.compile.sealed_code import kept

    whole = types.int64
    kinds = {ctypes.c_int64: whole, ctypes.c_double: types.float64}

    def external(name: str, function: Any, arguments: Any, returns: Any = types.int32) -> Any:
        """Return a function that compiled code knows by a symbol, so that it can be kept on disk."""
        address = function if isinstance(function, int) else ctypes.cast(function, ctypes.c_void_p).value
        binding.add_symbol(f"vtsdt_unit_{name}", address)
        return types.ExternalFunction(f"vtsdt_unit_{name}", returns(*(kinds[a] for a in arguments)))

    table_text = f"define i64 @vtsdt_unit_table() {{\n  ret i64 {unit.table.ctypes.data}\n}}\n"
    table_at = external("table", loaded(compiled(table_text), "vtsdt_unit_table"), (), whole)
    moved = external("moved", unit._moved, (ctypes.c_int64,), whole)
    called = {name: external(name, *given) for name, given in functions.items()}

    def elements_of(kind: Any) -> Any:
        def elements_at(typingctx, address):  # type: ignore[no-untyped-def]
            def emit(context, builder, signature, args):  # type: ignore[no-untyped-def]
                return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

            return types.CPointer(kind)(whole), emit

        return intrinsic(elements_at)

    floats_from, wholes_from = elements_of(types.float64), elements_of(whole)
    origin = VERSION + repr((unit.second, sorted(functions)))

    def compile(function: Any) -> Any:
        return kept(njit(nogil=True, error_model="numpy")(function), origin)

    @compile
    def table():  # type: ignore[no-untyped-def]
        return carray(wholes_from(table_at()), FIELDS)

    @compile
    def floats_at(address, count):  # type: ignore[no-untyped-def]
        return carray(floats_from(address), count)

    put = _written(compile, unit.second, table, floats_at, moved, **called)

    def question(wanted, given, _1, _2, values):  # type: ignore[no-untyped-def]
        known = table()
        put(int(wanted), given, carray(values, 2 * (known[STATES] + known[OUTS])))

    pointer = types.CPointer(types.float64)
    options: Any = {"nogil": True, "error_model": "numpy", "no_cpython_wrapper": True}
    made = kept(njit(**options)(question), origin)
    made.compile(types.void(types.float64, *[pointer] * 4))
    made.disable_compile()
    address = unit.table[QUESTION] = address_of_function(made)
    call = ctypes.CFUNCTYPE(None, ctypes.c_double, *[ctypes.c_void_p] * 4)(address)

    def on_arrays(wanted: int, given: np.ndarray, values: np.ndarray) -> None:
        at = given.ctypes.data
        call(float(wanted), at, at, at, values.ctypes.data)

    on_arrays.keep = made  # type: ignore[attr-defined]
    return on_arrays


def _written(
    compile: Any,
    second: bool,
    table_of: Any,
    floats_at: Any,
    moved: Any,
    set_time: Any,
    set_states: Any,
    set_values: Any,
    get_values: Any,
    get_rates: Any,
    directional: Any = None,
) -> Callable[..., None]:
    """Return the question made of functions of the unit, and of what reaches the table and what it points to."""
    if second:

        @compile
        def put(component, refs, count, values, size):  # type: ignore[no-untyped-def]
            return set_values(component, refs, count, values)

        @compile
        def get(component, refs, count, values, size):  # type: ignore[no-untyped-def]
            return get_values(component, refs, count, values)

    else:

        @compile
        def put(component, refs, count, values, size):  # type: ignore[no-untyped-def]
            return set_values(component, refs, count, values, size)

        @compile
        def get(component, refs, count, values, size):  # type: ignore[no-untyped-def]
            return get_values(component, refs, count, values, size)

    if directional is None:

        @compile
        def derive(component, unknown, n_unknown, known, n_known, seed, n_seed, out, n_out):  # type: ignore[no-untyped-def]
            return 0

    elif second:

        @compile
        def derive(component, unknown, n_unknown, known, n_known, seed, n_seed, out, n_out):  # type: ignore[no-untyped-def]
            return directional(component, unknown, n_unknown, known, n_known, seed, out)

    else:

        @compile
        def derive(component, unknown, n_unknown, known, n_known, seed, n_seed, out, n_out):  # type: ignore[no-untyped-def]
            return directional(component, unknown, n_unknown, known, n_known, seed, n_seed, out, n_out)

    @compile
    def go(table):  # type: ignore[no-untyped-def]
        """Take the unit to the point; return the worst status."""
        component, size, n, n_u = table[COMPONENT], table[SIZE], table[STATES], table[INPUTS]
        at, first = table[NOW], 1 + n + n_u
        now, has = floats_at(at, size), floats_at(table[PARAMETERS], size - first)
        same = table[STARTED] == 1
        for k in range(size - first):
            if now[first + k] != has[k]:
                same = False
        if not same and moved(0) == 0:
            return _DISCARD
        status = set_time(component, now[0])
        if n > 0:
            status = max(status, set_states(component, at + 8, n))
        if n_u > 0:
            status = max(status, put(component, table[IN_REF], table[N_IN], at + 8 * (1 + n), n_u))
        return status

    @compile
    def fetch(table, wanted):  # type: ignore[no-untyped-def]
        """Let the unit compute at the point where it is; return the worst status."""
        component, n, n_y, at, status = table[COMPONENT], table[STATES], table[OUTS], table[RESULT], 0
        if wanted & OUTPUTS and n_y > 0:  # before the rates: units by OpenModelica compute no outputs after them
            status = max(status, get(component, table[OUT_REF], table[N_OUT], at + 8 * n, n_y))
        if wanted & RATES and n > 0:
            status = max(status, get_rates(component, at, n))
        return status

    @compile
    def arrive(table, given, wanted):  # type: ignore[no-untyped-def]
        """Have at least what is wanted at a point; return the worst status."""
        size, count = table[SIZE], table[STATES] + table[OUTS]
        last, now = floats_at(table[GIVEN], size), floats_at(table[NOW], size)
        same = table[THERE] == 1
        for k in range(size):
            if same and last[k] != given[k]:
                same = False
        if same and table[HAVE] & wanted == wanted:
            return 0
        if not same:
            factor, offset = floats_at(table[FACTOR], size), floats_at(table[OFFSET], size)
            known = floats_at(table[KNOWN], size)
            for k in range(size):
                last[k] = given[k]
                now[k] = (given[k] - offset[k]) / factor[k]
                known[k] = 0.0
            table[HAVE] = 0
        wanted |= table[HAVE]  # what is known already is lost by going there again
        table[THERE] = 0
        status = go(table)
        if status <= _WARNING:
            status = max(status, fetch(table, wanted))
        if status > _WARNING:
            result = floats_at(table[RESULT], count)
            for k in range(count):
                result[k] = np.nan
            wanted = RATES | OUTPUTS
        table[HAVE], table[THERE] = wanted, 1
        return status

    @compile
    def column(table, k, columns):  # type: ignore[no-untyped-def]
        """Write a column of the Jacobian in the unit's numbers, by central differences; return the worst status."""
        size, count = table[SIZE], table[STATES] + table[OUTS]
        now, nominal = floats_at(table[NOW], size), floats_at(table[NOMINAL], size)
        result = floats_at(table[RESULT], count)
        here, status = now[k], 0
        h = _STEP * max(abs(here), nominal[k])
        kept_values = np.empty(count)
        for i in range(count):
            kept_values[i] = result[i]
        now[k] = here + h
        status = max(status, go(table))
        status = max(status, fetch(table, RATES | OUTPUTS))
        for i in range(count):
            columns[i] = result[i]
        now[k] = here - h
        status = max(status, go(table))
        status = max(status, fetch(table, RATES | OUTPUTS))
        width = (here + h) - (here - h)
        for i in range(count):
            columns[i] = (columns[i] - result[i]) / width if status <= _WARNING else np.nan
            result[i] = kept_values[i]
        now[k] = here
        status = max(status, go(table))
        return status

    @compile
    def slopes(table, given, wanted, values):  # type: ignore[no-untyped-def]
        """Add up the derivatives along a direction; return the worst status."""
        size, n, n_y, exact = table[SIZE], table[STATES], table[OUTS], table[EXACT]
        count = n + n_y
        along, factor = floats_at(table[ALONG], size), floats_at(table[FACTOR], size)
        moves = False
        for k in range(1, size):
            along[k] = given[size + k - 1] / factor[k]
            if k <= exact and along[k] != 0.0:
                moves = True
        for i in range(count):
            values[i] = 0.0
        status = 0
        known = floats_at(table[KNOWN], size)
        for k in range(exact + 1, size):
            if along[k] != 0.0:
                columns = floats_at(table[COLUMNS] + 8 * count * k, count)
                if known[k] == 0.0:  # many directions are asked for at one point: each column is taken once
                    status = max(status, column(table, k, columns))
                    known[k] = 1.0
                for i in range(count):
                    values[i] += columns[i] * along[k]
        if moves:
            first = 0 if wanted & RATES else n
            last = count if wanted & OUTPUTS else n
            n_refs, at = 0, table[UNKNOWN_REF]
            if wanted & RATES:
                n_refs += table[N_RATES]
            else:
                at += 4 * table[N_RATES]
            if wanted & OUTPUTS:
                n_refs += table[N_OUT]
            slope = floats_at(table[SLOPE], count)
            status = max(
                status,
                derive(
                    table[COMPONENT],
                    at,
                    n_refs,
                    table[KNOWN_REF],
                    table[N_KNOWN],
                    table[ALONG] + 8,
                    exact,
                    table[SLOPE] + 8 * first,
                    last - first,
                ),
            )
            for i in range(first, last):
                values[i] += slope[i]
        return status

    @compile
    def answer(wanted, given, values):  # type: ignore[no-untyped-def]
        """Ask the unit at a point, or along a direction there; nan where it gives no answer."""
        table = table_of()
        count = table[STATES] + table[OUTS]
        table[COUNT] += 1
        table[BUSY] = 1
        plain = wanted & (RATES | OUTPUTS)
        status = arrive(table, given, plain)
        result = floats_at(table[RESULT], count)
        factor, offset = floats_at(table[OUT_FACTOR], count), floats_at(table[OUT_OFFSET], count)
        for i in range(count):
            values[i] = result[i] * factor[i] + offset[i]
        if wanted & SLOPES:
            along = values[count:]
            status = max(status, slopes(table, given, plain, along))
            for i in range(count):
                along[i] = along[i] * factor[i] if status <= _WARNING else np.nan
        table[BUSY] = 0
        if status > _DISCARD and table[FAULT] == 0:
            table[FAULT] = status

    result: Callable[..., None] = answer
    return result
