"""Progress: what a long function reports while it works, and the display that shows it."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from multibody.base.compile_events import on_compile
from multibody.base.terminal_text import printable

__all__ = ["Progress", "ProgressLine", "Step", "shown_in_notebooks", "silent", "visible"]

#: What a long function calls with a line of text now and then; a `Step` also says which part of the work is done.
Progress = Callable[[str], None]

P = ParamSpec("P")
R = TypeVar("R")

PATIENCE = 2.0  # s of work before the first line is printed where lines cannot be removed
INTERVAL = 5.0  # s between printed lines of one kind


def silent(text: str) -> None:
    """Ignore a line of progress."""


class Step(str):
    """A line of progress that says how much of a countable piece of work is done.

    Parameters
    ----------
    text : str
        What is being done.
    done, total : int
        Finished items, and all items.

    Examples
    --------
    >>> step = Step("simulate trip 3 of 8", 2, 8)
    >>> step, step.share
    ('simulate trip 3 of 8', 0.25)
    """

    done: int
    total: int

    def __new__(cls, text: str, done: int, total: int) -> Step:
        step = super().__new__(cls, text)
        step.done, step.total = done, total
        return step

    @property
    def share(self) -> float:
        """Finished share of the work, 0 to 1."""
        return self.done / self.total if self.total else 1.0


def seconds_text(seconds: float) -> str:
    """Return a duration in words.

    Examples
    --------
    >>> seconds_text(8.2), seconds_text(150.0)
    ('8 s', '2 min 30 s')
    """
    whole = max(1, round(seconds))
    return f"{whole} s" if whole < 60 else f"{whole // 60} min {whole % 60} s"


class ProgressLine(AbstractContextManager["ProgressLine"]):
    """A line that is replaced on a terminal or in a notebook, plain lines elsewhere, or nothing.

    A context manager that removes the line at its end, and a callable that takes its text.  A `Step` adds a bar with
    the finished share of that piece of work and an estimate of the time left.  Compilations are folded into one line.
    Where lines cannot be replaced, those of one kind (the same text before the first colon) are printed every few
    seconds only.  Everything goes to standard error: standard output is for results.

    Parameters
    ----------
    quiet : bool
        Show nothing.

    Examples
    --------
    >>> with ProgressLine(quiet=True) as progress:
    ...     progress("trip 1 of 8")
    """

    def __init__(self, quiet: bool = False) -> None:
        self.quiet = quiet
        self._lock = threading.Lock()
        self._display: _Terminal | _Notebook | None = None
        self._start = time.monotonic()
        self._printed = (float("-inf"), "")  # when, and the kind
        self._compiled = 0
        self._text = ""
        self._counted = (0, float("-inf"), 0)  # items of the work in hand, when it began, and at which item
        self._unsubscribe: Callable[[], None] | None = None

    def __enter__(self) -> ProgressLine:
        if not self.quiet:
            self._unsubscribe = on_compile(self._compiling)
        return self

    def _compiling(self, name: str, seconds: float | None) -> None:
        if seconds is not None:
            return
        self._compiled += 1
        if self._live() is not None:
            self._show(self._text or "prepare the model", None)
        elif self._compiled == 1:
            self("compile the model's equations (once on this machine)")

    def __call__(self, text: str) -> None:
        """Show what is being done."""
        if self.quiet:
            return
        with self._lock:
            step = text if isinstance(text, Step) else None
            self._text = printable(str(text))
            left = self._seconds_left(step)
            if self._live() is not None:
                self._show(self._text, step, left)
                return
            now, kind = time.monotonic(), text.partition(":")[0]
            printed, last = self._printed
            if step is not None:
                kind = f"{step.total} steps"  # the items of one piece of work are of one kind
            if now - self._start > PATIENCE and (kind != last or now - printed > INTERVAL):
                estimate = f" (about {seconds_text(left)} left)" if left is not None else ""
                sys.stderr.write(f"{now - self._start:6.1f} s  {self._text}{estimate}\n")
                sys.stderr.flush()
                self._printed = (now, kind)

    def _seconds_left(self, step: Step | None) -> float | None:
        """Return the estimated time to the end of a piece of countable work, s; None where nothing is finished yet."""
        now = time.monotonic()
        if step is None:
            self._counted = (0, now, 0)
            return None
        total, begun, first = self._counted
        if step.total != total or step.done < first:
            self._counted = (step.total, now, step.done)
            return None
        finished = step.done - first
        return (now - begun) / finished * (step.total - step.done) if finished else None

    def _show(self, text: str, step: Step | None, left: float | None = None) -> None:
        display = self._live()
        if display is not None:
            notes = [f"about {seconds_text(left)} left"] if left is not None else []
            notes.append(f"{seconds_text(time.monotonic() - self._start)} so far")
            if self._compiled:
                notes.append(f"{self._compiled} functions compiled")
            display.show(text, step, ", ".join(notes))

    def _live(self) -> _Terminal | _Notebook | None:
        """Return the display whose line can be replaced; None where there is none."""
        if self._display is None:
            if sys.stderr.isatty():
                self._display = _Terminal()
            elif _in_notebook():
                self._display = _Notebook()
        return self._display

    def __exit__(self, *error: object) -> None:
        if self._unsubscribe is not None:
            self._unsubscribe()
            self._unsubscribe = None
        if self._display is not None:
            self._display.close()
            self._display = None


class _Terminal:
    """A line of a terminal, with a bar where the work can be counted; text that does not fit is cut, times are not."""

    WIDTH = 10  # characters of the bar
    SPINNER = 2  # characters before the line: the spinner and a space

    def __init__(self) -> None:
        from rich.console import Console

        self._console = Console(stderr=True, highlight=False)
        self._status = self._console.status("")
        self._status.start()

    def show(self, text: str, step: Step | None, notes: str) -> None:
        """Replace the line."""
        from rich.text import Text

        line = Text()
        if step is not None:
            full = round(self.WIDTH * step.share)
            line.append("━" * full, "green").append("━" * (self.WIDTH - full), "dim").append(f" {step.share:.0%} ")
        room = self._console.width - self.SPINNER - line.cell_len
        what, times = Text(text), Text(f"  {notes}", "dim")
        what.truncate(max(room - times.cell_len, 1), overflow="ellipsis")
        times.truncate(max(room - what.cell_len, 1), overflow="ellipsis")
        self._status.update(line.append_text(what).append_text(times))

    def close(self) -> None:
        """Remove the line."""
        self._status.stop()


def _in_notebook() -> bool:
    """Tell whether a notebook's kernel runs this process."""
    if "IPython" not in sys.modules:
        return False
    import IPython

    shell = IPython.get_ipython()  # type: ignore[no-untyped-call,attr-defined]
    return shell is not None and getattr(shell, "kernel", None) is not None


class _Notebook:
    """A line below a notebook's cell; no widget is needed, so that a stored notebook shows it as well."""

    INTERVAL = 0.1  # s between updates: each is a message to the page

    def __init__(self) -> None:
        from IPython.display import HTML, display

        self._html = HTML
        self._handle: Any = display(HTML(""), display_id=True)  # type: ignore[no-untyped-call]
        self._updated = float("-inf")

    def show(self, text: str, step: Step | None, notes: str) -> None:
        """Replace the line."""
        from html import escape

        now = time.monotonic()
        if now - self._updated < self.INTERVAL:
            return
        self._updated = now
        bar = f"<progress value='{step.share:.3f}'></progress> {step.share:.0%} " if step is not None else ""
        self._handle.update(self._html(f"{bar}{escape(text)} <small>({escape(notes)})</small>"))

    def close(self) -> None:
        """Remove the line."""
        self._handle.update(self._html(""))


@contextmanager
def visible(progress: Progress) -> Iterator[Progress]:
    """Give the progress that was asked for or, in a notebook where none was, a line below the cell."""
    if progress is not silent or not _in_notebook():
        yield progress
        return
    with ProgressLine() as line:
        yield line


def shown_in_notebooks(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function with an argument ``progress`` show it below a notebook's cell where nobody asks for another."""

    @wraps(function)
    def showing(*args: P.args, **options: P.kwargs) -> R:
        with visible(options.pop("progress", silent)) as progress:  # type: ignore[arg-type]
            return function(*args, progress=progress, **options)  # type: ignore[arg-type]

    return showing
