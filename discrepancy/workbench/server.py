"""The workbench's web application: one page, and what it asks for as JSON; for this computer, with a token."""

from __future__ import annotations

import hmac
import json
import math
import re
from collections.abc import Awaitable, Callable, Mapping
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from discrepancy.report.write import write_report
from discrepancy.study.script import script_of
from discrepancy.workbench.session import Busy, Session

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response

__all__ = ["LOOPBACK", "application", "served"]

#: From the arguments of a request to what the page gets.
Work = Callable[[Any], Any]


#: Names under which a browser on this computer reaches the page; a request for any other host is refused, so that no
#: foreign page can reach it by a name of its own that points here.
LOOPBACK = ["127.0.0.1", "localhost", "[::1]"]
#: What the page may load and reach: its own text and this server.
CONTENT_SECURITY_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; connect-src 'self'; "
    "frame-ancestors 'none'"
)
WAIT = 10.0  # s for which a question for news is held open


def application(session: Session, token: str, hosts: list[str] | None = None) -> Starlette:
    """Return the application.

    Parameters
    ----------
    session : Session
    token : str
        Has to stand in the address of every request.
    hosts : list of str, optional
        Host names that may stand in a request; default: those of this computer.
    """

    def news(given: Any) -> Any:
        session.wait(int(given.get("since", -1)), WAIT)
        return session.state()

    def figures(given: Any) -> Any:
        with session.giving_way.request():
            return session.figures(
                given.get("record", ""),
                start=-math.inf if given.get("start") is None else float(given["start"]),
                stop=math.inf if given.get("stop") is None else float(given["stop"]),
                against=int(given.get("against", 1)),
                predict=given.get("predict", ""),
                values=given.get("values") or None,
                outputs=given.get("outputs"),
                columns=None if given.get("columns") is None else int(given["columns"]),
                ends=None if given.get("ends") is None else [int(k) for k in given["ends"]],
            )

    def do(given: Any) -> Any:
        session.do(str(given.get("action")), given)
        return session.state()

    def stop(given: Any) -> Any:
        session.stop()
        return session.state()

    reading = {
        "state": news,
        "candidates": lambda given: session.candidates(),
        "kind": lambda given: session.kind(given.get("name", "")),
        "machine": lambda given: session.machine(),
        "where": lambda given: session.where(),
        "motion": lambda given: session.against_motion(given.get("output", "")),
        "spectra": lambda given: session.spectra(given.get("record", "")),
        "force": lambda given: session.force(given.get("where", "")),
        "branches": lambda given: session.branches(int(given.get("one", 0)), int(given.get("other", 1))),
        "table": lambda given: session.table(int(given["against"]) if "against" in given else None),
    }
    posts = {
        "figures": figures,
        "do": do,
        "stop": stop,
        "export": lambda given: export(session, str(given.get("what"))),
    }
    return served("page.html", reading, posts, token, hosts)


def served(
    template: str,
    reading: Mapping[str, Work],
    posts: Mapping[str, Work],
    token: str,
    hosts: list[str] | None = None,
) -> Starlette:
    """Return an application of one page and what it asks for as JSON.

    Parameters
    ----------
    template : str
        Name of the page.
    reading, posts : mapping of str to callable
        What is asked for, and what is done: from the arguments to what JSON can hold.
    token : str
        Has to stand in the address of every request.
    hosts : list of str, optional
        Host names that may stand in a request; default: those of this computer.
    """
    from starlette.applications import Starlette
    from starlette.concurrency import run_in_threadpool
    from starlette.middleware import Middleware
    from starlette.middleware.trustedhost import TrustedHostMiddleware
    from starlette.responses import HTMLResponse, PlainTextResponse, Response
    from starlette.routing import Route

    def answered(work: Work) -> Callable[[Request], Awaitable[Response]]:
        """Return the handler that does a piece of reading in a thread and answers with JSON."""

        async def handler(request: Request) -> Response:
            if refused := _refused(request, token):
                return PlainTextResponse(refused, status_code=403)
            given = (
                json.loads(await request.body() or b"{}") if request.method == "POST" else dict(request.query_params)
            )
            try:
                content = await run_in_threadpool(work, given)
            except Busy as error:
                return _json({"error": str(error)}, 409)
            except (KeyError, ValueError, RuntimeError, TypeError) as error:
                return _json({"error": str(error.args[0] if error.args else error)}, 400)
            return _json(content, 200)

        return handler

    def _json(content: Any, status: int) -> Response:
        text = json.dumps(_finite(content), ensure_ascii=False)
        return Response(text, status, media_type="application/json", headers={"Cache-Control": "no-store"})

    async def page(request: Request) -> Response:
        if refused := _refused(request, token):
            return PlainTextResponse(refused, status_code=403)
        headers = {"Content-Security-Policy": CONTENT_SECURITY_POLICY, "Referrer-Policy": "no-referrer"}
        return HTMLResponse(_page(template), headers=headers)

    routes = [Route("/", page)]
    routes += [Route(f"/{name}", answered(work)) for name, work in reading.items()]
    routes += [Route(f"/{name}", answered(work), methods=["POST"]) for name, work in posts.items()]
    allowed = Middleware(TrustedHostMiddleware, allowed_hosts=hosts or LOOPBACK)
    return Starlette(routes=routes, middleware=[allowed])


def export(session: Session, what: str) -> dict[str, Any]:
    """Write the report, the model or the script beside the history; return what was written.

    Parameters
    ----------
    session : Session
    what : {"report", "model", "fmu", "script"}

    Raises
    ------
    ValueError
        If it is none of these.
    """
    study, folder = session.study, session.history.parent
    if what == "report":
        return {"written": [str(p) for p in write_report(study.conclude(), folder)[:2]]}
    stage = study.stage
    if what == "model":
        from multibody.model.storage import save

        return {"written": [str(save(stage.machine or stage.model, folder / "model.json"))]}
    if what == "fmu":
        path = folder / f"{study.problem.model.name}.fmu"
        (stage.machine or stage.model).build().to_fmu(path)
        return {"written": [str(path)]}
    if what == "script":
        path = folder / "steps.py"
        file = study.problem.path
        if file is None:
            raise ValueError("a script needs the study file, and this study was not read from one")
        path.write_text(script_of(study.steps, Path(file).resolve(), study.problem.seed), encoding="utf-8")
        return {"written": [str(path)]}
    raise ValueError(f"there is no export '{what}': take one of report, model, fmu, script")


def _refused(request: Request, token: str) -> str:
    """Return why a request is refused, or an empty text."""
    given = request.query_params.get("token", "")
    if not hmac.compare_digest(given.encode(), token.encode()):
        return "This page needs the address that 'vtsdt open' printed, with its token.\n"
    return ""


def _finite(value: Any) -> Any:
    """Return a value with None in place of numbers that JSON does not know."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    return value


def _page(template: str) -> str:
    """Return a page with its style and scripts in it."""
    folder = resources.files("discrepancy") / "templates"
    page = (folder / "workbench" / template).read_text(encoding="utf-8")
    return re.sub(r"/\*([\w/]+\.(?:css|js))\*/", lambda m: (folder / m[1]).read_text(encoding="utf-8"), page)
