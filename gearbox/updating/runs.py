"""Many runs of a virtual model: in parallel, each stored as soon as it is there, none done twice.

Runs are lines of a JSONL file.  After an interruption the same call reads what is there and does the rest; a last line
that was cut off while it was written is done again.
"""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np

from gearbox.files.operating_condition import OperatingCondition
from gearbox.signals.signal import Signal
from gearbox.updating.virtual import Run, Settings, VibrationModel, run_model
from multibody.base.process_pool import process_pool
from multibody.base.progress import Progress, Step, silent

__all__ = ["ModelSource", "Runs"]

_log = logging.getLogger(__name__)
_SCHEMA = 1


@dataclass(frozen=True)
class ModelSource:
    """Where a virtual model comes from, in words that another process can follow.

    Parameters
    ----------
    load : callable
        Takes ``argument`` and returns the model; a function at the top of a module, so that a process can import it.
    argument : str
        JSON, or any text that ``load`` understands.
    identity : str
        Changes when the model does: stored runs of another identity are not used.
    """

    load: Callable[[str], VibrationModel]
    argument: str
    identity: str = ""


_LOADED: dict[tuple[str, str], VibrationModel] = {}


def _run_in_process(
    source: ModelSource, values: Mapping[str, float], condition: OperatingCondition, settings: Settings
) -> Run:
    """Load the model once in each process, and run it."""
    key = (source.argument, source.identity)
    if key not in _LOADED:
        _LOADED[key] = source.load(source.argument)
    return run_model(_LOADED[key], values, condition, settings)


class Runs:
    """Runs of one virtual model, stored in a file.

    Parameters
    ----------
    source : ModelSource or callable
        A callable is run in this process, unless an executor is given that can pass it on.
    settings : Settings
    store : Path, optional
        JSONL file; its folder also gets the signals of runs that do not repeat with the mesh.
    processes : int
        Processes to spread runs over; 1 runs in this one.
    executor : Executor, optional
        Takes the place of the processes.
    progress : callable
        Gets a line of text for each run.

    Notes
    -----
    ``done`` counts the runs made, ``reused`` those that were there already, ``lost`` lines of the file that could not
    be read, ``seconds`` the computing time of the runs made.
    """

    def __init__(
        self,
        source: ModelSource | VibrationModel,
        settings: Settings,
        *,
        store: Path | None = None,
        processes: int = 1,
        executor: Executor | None = None,
        progress: Progress = silent,
    ) -> None:
        self.source, self.settings, self.store, self.progress = source, settings, store, progress
        self.processes, self._executor = max(1, int(processes)), executor
        self._own: Executor | None = None
        self.done = self.reused = self.lost = 0
        self.seconds = 0.0
        self._identity = source.identity if isinstance(source, ModelSource) else repr(source)
        self._known: dict[str, Run] = {}
        if store is not None:
            store.parent.mkdir(parents=True, exist_ok=True)
            self._known = dict(self._read(store))

    def __enter__(self) -> Runs:
        return self

    def __exit__(self, *error: object) -> None:
        self.close(cancel=error[0] is not None)

    def close(self, cancel: bool = False) -> None:
        """End the processes; with ``cancel`` without the runs that have not begun."""
        if self._own is not None:
            self._own.shutdown(wait=True, cancel_futures=cancel)
            self._own = None

    def __len__(self) -> int:
        return len(self._known)

    def key(self, values: Mapping[str, float], condition: OperatingCondition) -> str:
        """Name of a run: the same for the same model, parameters, condition and settings."""
        content = [
            _SCHEMA,
            self._identity,
            sorted((n, float(v)) for n, v in values.items()),
            float(condition.speed_rpm),
            float(condition.load_Nm),
            asdict(self.settings),
        ]
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:24]

    def one(self, values: Mapping[str, float], condition: OperatingCondition) -> Run:
        """A single run."""
        return self.many([(values, condition)])[0]

    def many(
        self, wanted: Sequence[tuple[Mapping[str, float], OperatingCondition]], what: str = "simulation"
    ) -> list[Run]:
        """Runs in the order asked for; those not stored yet are made, in parallel.

        Parameters
        ----------
        wanted : sequence of (values, condition)
        what : str
            Said while it goes on.
        """
        keys = [self.key(values, condition) for values, condition in wanted]
        missing = {k: pair for k, pair in zip(keys, wanted, strict=True) if k not in self._known}
        self.reused += len(set(keys)) - len(missing)
        before = self.done

        def keep(key: str, run: Run) -> None:
            self._keep(key, run)
            done = self.done - before
            self.progress(Step(f"{what}: {done} of {len(missing)} simulated", done, len(missing)))

        self._make(missing, keep)
        return [self._known[key] for key in keys]

    # ---------------------------------------------------------------- making

    def _make(
        self,
        missing: Mapping[str, tuple[Mapping[str, float], OperatingCondition]],
        keep: Callable[[str, Run], None],
    ) -> None:
        if isinstance(self.source, ModelSource):
            work: Callable[..., Run] = partial(_run_in_process, self.source)
        else:
            work = partial(run_model, self.source)
        executor = self._pool(len(missing))
        if executor is None:
            for key, (values, condition) in missing.items():
                keep(key, work(values, condition, self.settings))
            return
        # Only a few are handed over at a time, so that an interruption waits for no more than these.
        queue = iter(missing.items())
        running: dict[Future[Run], str] = {}
        try:
            while True:
                while len(running) < 2 * self.processes and (item := next(queue, None)) is not None:
                    key, (values, condition) = item
                    running[executor.submit(work, values, condition, self.settings)] = key
                if not running:
                    return
                finished, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in finished:
                    run = future.result()
                    keep(running.pop(future), run)
        finally:
            for future, key in running.items():
                # After an interruption, what is finished is kept and what has not begun never begins.
                if not future.cancel() and future.done() and future.exception() is None:
                    keep(key, future.result())

    def _pool(self, count: int) -> Executor | None:
        if self._executor is not None:
            return self._executor
        if self.processes == 1 or count < 2 or not isinstance(self.source, ModelSource):
            return self._own
        if self._own is None:
            self._own = process_pool(self.processes)
        return self._own

    # ---------------------------------------------------------------- keeping

    def _keep(self, key: str, run: Run) -> None:
        self._known[key] = run
        self.done += 1
        self.seconds += run.seconds
        if self.store is None:
            return
        if run.signals:
            arrays = {f"{sensor}|{x.rate!r}|{x.unit}": x.values.astype(np.float32) for sensor, x in run.signals.items()}
            path = self._signals_of(key)
            path.parent.mkdir(exist_ok=True)
            draft = path.with_suffix(".part.npz")
            np.savez_compressed(draft, **arrays)  # type: ignore[arg-type]
            draft.replace(path)
        with self.store.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"key": key, "signals": bool(run.signals), **run.to_dict()}) + "\n")
            file.flush()

    def _signals_of(self, key: str) -> Path:
        assert self.store is not None
        return self.store.parent / f"{self.store.stem}_signals" / f"{key}.npz"

    def _read(self, store: Path) -> Iterator[tuple[str, Run]]:
        if not store.exists():
            return
        text = store.read_text(encoding="utf-8")
        for line in text.splitlines():
            try:
                content = json.loads(line, parse_constant=_refuse)
                signals = self._load_signals(content["key"]) if content["signals"] else None
                yield content["key"], Run.from_dict(content, signals)
            except (ValueError, KeyError, TypeError, OSError):
                self.lost += 1
        if self.lost:
            _log.warning("%s: %d run(s) cannot be read and are done again", store.name, self.lost)
        if text and not text.endswith("\n"):
            # The rest of a line that was cut off must not swallow the next one.
            with store.open("a", encoding="utf-8") as file:
                file.write("\n")

    def _load_signals(self, key: str) -> dict[str, Signal]:
        signals = {}
        with np.load(self._signals_of(key), allow_pickle=False) as arrays:
            for name in arrays.files:
                sensor, rate, unit = name.split("|")
                signals[sensor] = Signal(arrays[name], float(rate), name=sensor, unit=unit)
        return signals


def _refuse(constant: str) -> float:
    """Raise for a number that no run can be used with."""
    raise ValueError(f"{constant} is no finite number")
