"""The command ``vtsdt open``: a study, or a finished result, in the browser."""

from __future__ import annotations

import contextlib
import json
import secrets
import socket
import sys
import threading
import webbrowser
from argparse import Namespace
from collections.abc import Callable, Mapping
from pathlib import Path
from types import FrameType
from typing import Any

from discrepancy.problem.study_file import StudyError
from discrepancy.study.history import restore
from discrepancy.study.study import Study
from discrepancy.workbench.session import Session

__all__ = ["View", "open_session", "serve", "serve_result"]

#: From the positions of a page's sliders, by name, to what the page shows.
View = Callable[[Mapping[str, float]], dict[str, Any]]

#: Seconds after which a thread that computes lets another run; Python's own value is ten times as long.  A request
#: passes through several threads, and would wait so long at each while candidates are scored in the background.
SWITCH_INTERVAL = 5e-4

MISSING = (
    "vtsdt open needs the packages of the workbench, and {} is not installed: pip install 'vtsdt[workbench]', or "
    'pip install -c constraints.txt -e ".[workbench]" in a checkout'
)


def open_session(target: str | Path, out: str | Path | None = None) -> Session:
    """Return the session of a study file, of a folder with a finished diagnosis, or of a history.

    Parameters
    ----------
    target : path
    out : path, optional
        Folder for the history and what is exported; default: that of the history, or ``workbench`` beside the study.

    Raises
    ------
    StudyError
        If it is none of these, or its study file is not where it was.
    """
    target = Path(target)
    history: Path | None = None
    if target.is_dir():
        history = target / "history.json"
        if not history.is_file():
            raise StudyError(
                [f"{target}: there is no history.json in this folder: give a study file, or diagnose it first"]
            )
    elif target.suffix == ".json":
        history = target
    study_file = target if history is None else _study_of(history)
    folder = Path(out) if out is not None else history.parent if history else study_file.parent / "workbench"
    study = Study.from_file(study_file)
    session = Session(study, folder / "history.json")
    if history is not None:
        session.begin("restore the stages of the history", lambda: restore(study, history))
    else:
        session.begin("compare the model with the records", lambda: study.stage)
    return session


def _study_of(history: Path) -> Path:
    """Return the study file that a history was made from, as the diagnosis beside it names it."""
    for name in ("diagnosis.json", "comparison.json"):
        beside = history.with_name(name)
        if beside.is_file():
            paths = json.loads(beside.read_text(encoding="utf-8")).get("paths") or []
            if paths and Path(paths[0]).is_file():
                return Path(paths[0])
    file = json.loads(history.read_text(encoding="utf-8")).get("file")
    if file and Path(file).is_file():
        return Path(file)
    raise StudyError(
        [f"{history}: its study file is not where it was: open the study file with --out {history.parent}"]
    )


def serve(args: Namespace) -> int:
    """Open a study in the browser, until the command is interrupted.

    Parameters
    ----------
    args : namespace
        ``target``, ``out``, ``port``, ``browser``.
    """
    _needed()
    from discrepancy.workbench.server import application

    session = open_session(args.target, args.out)
    _listen(lambda token: application(session, token), session.close, args)
    print(f"every step is in {session.history}", file=sys.stderr)
    return 0


def serve_result(view: View, args: Namespace) -> int:
    """Show a finished result in the browser, until the command is interrupted.

    Parameters
    ----------
    view : callable
        From the positions of the page's sliders to what it shows: see `discrepancy.workbench.result_page`.
    args : namespace
        ``port``, ``browser``.
    """
    _needed()
    from discrepancy.workbench.result_page import result_application

    _listen(lambda token: result_application(view, token), lambda: None, args)
    return 0


def _needed() -> None:
    try:
        import starlette
        import uvicorn
    except ImportError as error:
        raise StudyError([MISSING.format(error.name)]) from None
    _ = starlette, uvicorn


def _listen(application: Callable[[str], Any], close: Callable[[], None], args: Namespace) -> None:
    """Run an application, made for a new token, on this computer until it is interrupted."""
    import uvicorn

    from discrepancy.workbench.server import LOOPBACK

    sys.setswitchinterval(SWITCH_INTERVAL)
    token = secrets.token_urlsafe(16)
    with socket.socket() as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((LOOPBACK[0], args.port))
        listener.listen()  # a browser that asks before the server runs is answered when it does
        address = f"http://{LOOPBACK[0]}:{listener.getsockname()[1]}/?token={token}"
        print(f"the workbench is at {address}\nit is for this computer only; Ctrl-C ends it", flush=True)
        if args.browser:
            threading.Timer(0.3, webbrowser.open, [address]).start()
        # the application has nothing to begin or end; a lifespan task would print a traceback at Ctrl-C
        config = uvicorn.Config(application(token), lifespan="off", log_level="warning", timeout_graceful_shutdown=1)

        class Server(uvicorn.Server):
            def handle_exit(self, sig: int, frame: FrameType | None) -> None:
                close()  # a page that waits for news would hold the server up
                super().handle_exit(sig, frame)

        with contextlib.suppress(KeyboardInterrupt):
            Server(config).run(sockets=[listener])
    close()
