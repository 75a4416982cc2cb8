"""The workbench: what the page asks for, who may ask, and that every step can be taken again."""

from __future__ import annotations

import base64
import json
import re
import socket
import threading
import time
import urllib.error
import urllib.parse
import urllib.request
from email.message import Message
from typing import NamedTuple

import numpy as np
import pytest
from test_study_history import problem_of

from discrepancy.problem.study_file import StudyError
from discrepancy.study.history import restore, save_history
from discrepancy.study.script import replay
from discrepancy.study.study import Study
from discrepancy.workbench.command import open_session
from discrepancy.workbench.giving_way import GivingWay
from discrepancy.workbench.session import Busy, Session
from discrepancy.workbench.time_view import rows_for
from multibody.base.quantity_text import unit_text
from multibody.base.thinning import extreme_rows

NAME, OUTPUT = "coulomb_friction@guide", "carriage.position"


def _done(session: Session, action: str, **given: object) -> None:
    session.do(action, given)
    session.join()
    assert session.state()["error"] == ""


@pytest.fixture(scope="module")
def session(tmp_path_factory) -> Session:
    """A session in which a wrong effect was added and removed, and the right one added."""
    session = Session(Study(problem_of()), tmp_path_factory.mktemp("workbench") / "history.json")
    session.begin("compare", lambda: session.study.stage)
    session.join()
    _done(session, "score")
    _done(session, "add", effect="sensor_offset@carriage.position")
    _done(session, "undo")
    _done(session, "add", effect=NAME)
    return session


def _numbers(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype="<f4")


def test_the_state_has_stages_records_and_steps(session):
    state = session.state()
    assert [s["name"] for s in state["stages"]] == ["as given", "recalibrated", f"+ {NAME}"]
    assert [s["action"] for s in state["steps"]] == ["add", "undo", "add"]
    assert [r["part"] for r in state["records"]] == ["identify", "identify", "validate"]
    (branch,) = state["branches"]
    assert branch["names"][2:] == ("+ sensor_offset@carriage.position",)
    assert branch["title"].startswith("+ ")
    assert state["doing"] is None
    assert state["can_undo"]
    json.dumps(state, allow_nan=False)


def test_the_error_falls_on_held_out_records(session):
    errors = [s["rmse"]["validate"][OUTPUT] for s in session.state()["stages"]]
    assert errors[2] < 0.2 * errors[1]


def test_history_of_the_clicks_gives_the_same_numbers(session):
    again = Study(problem_of())
    restore(again, session.history)
    assert again.stage.rmse("validate") == session.study.stage.rmse("validate")
    assert again.steps == session.study.steps


def test_figures_have_the_measurement_and_the_models(session):
    (figure,) = session.figures("run1")
    signal = session.study.compare().of(record="run1")[0]
    assert [m["style"] for m in figure["models"]] == ["before", "after"]
    shown = _numbers(figure["measured"])
    assert shown.max() == np.float32(signal.measured.max())
    assert shown.min() == np.float32(signal.measured.min())
    (part,) = session.figures("run1", start=3.0, stop=4.0)
    time = part["from"] + _numbers(part["x"])
    assert time[0] == pytest.approx(2.99)
    assert time[-1] == pytest.approx(4.0, abs=0.011)


def test_only_the_outputs_in_sight_are_sent_with_numbers(session):
    (seen,) = session.figures("run1", outputs=[OUTPUT])
    assert seen == session.figures("run1")[0]
    (unseen,) = session.figures("run1", outputs=[])
    lines = [unseen["x"], unseen["measured"], *(m["y"] for m in unseen["models"])]
    assert lines == [""] * len(lines)
    for key in ("title", "label", "whole", "marks", "noise"):
        assert unseen[key] == seen[key]
    assert [m["name"] for m in unseen["models"]] == [m["name"] for m in seen["models"]]


def test_what_was_added_by_hand_is_said_in_the_answer(session):
    sentence = session.study.conclude().sentence
    assert sentence.startswith("Added by hand: dry (Coulomb) friction at guide.")
    assert "carriage.position" in sentence


def test_another_branch_can_be_compared_with(session):
    (figure,) = session.figures("run0", against=3)
    assert "sensor" in figure["models"][0]["name"]
    rows = session.table(against=3)
    assert all(r["before"] > 2.0 * r["rmse"] for r in rows)
    assert all(r["before"] is None for r in session.table())


def test_two_branches_are_shown_side_by_side(session):
    both = session.branches()
    assert [s["number"] for s in both["shown"]] == [0, 1]
    assert [s["stages"][-1]["name"] for s in both["shown"]] == [f"+ {NAME}", "+ sensor_offset@carriage.position"]
    friction, offset = (s["stages"][-1]["rmse"]["validate"][OUTPUT] for s in both["shown"])
    assert friction < 0.5 * offset
    (figure,) = session.figures("run0", ends=[0, 1])
    assert [(m["name"], m["style"]) for m in figure["models"]] == [("B", "before"), ("A", "after")]
    (plain,) = session.figures("run0", against=3)
    assert [m["y"] for m in figure["models"]] == [m["y"] for m in plain["models"]]
    with pytest.raises(KeyError, match="there is no branch 7"):
        session.branches(0, 7)


def test_what_was_left_out_is_used_again_and_a_branch_is_gone_on_from(tmp_path):
    session = Session(Study(problem_of()), tmp_path / "history.json")
    session.begin("compare", lambda: session.study.stage)
    session.join()
    before = session.state()["stages"]
    _done(session, "leave_out", record="run0", start=2.0, stop=4.0)
    (stretch,) = session.state()["left_out"]
    assert stretch["words"] == "run0 from 2 s to 4 s"
    assert session.state()["branches"][0]["title"] == "recalibrated"
    _done(session, "use_again", record=stretch["record"], start=stretch["start"], stop=stretch["stop"])
    assert session.state()["left_out"] == []
    assert session.state()["stages"] == before
    assert [b["title"] for b in session.state()["branches"]] == ["recalibrated, without run0 from 2 s to 4 s"]
    _done(session, "switch", branch=0)
    assert [s["words"] for s in session.state()["left_out"]] == ["run0 from 2 s to 4 s"]
    _done(session, "undo")
    assert session.state()["stages"] == before


def test_the_folder_of_a_finished_diagnosis_shows_its_answer(tmp_path):
    study = Study(problem_of())
    study.checkpoint = lambda s: save_history(s, tmp_path / "history.json")
    sentence = study.diagnose().sentence
    again = Session(Study(problem_of()), tmp_path / "history.json")
    again.begin("restore", lambda: restore(again.study, tmp_path / "history.json"))
    again.join()
    assert again.state()["conclusion"]["sentence"] == sentence
    _done(again, "undo")
    assert again.state()["conclusion"] == {}
    assert [s["name"] for s in again.state()["stages"]] == ["as given", "recalibrated"]


def test_the_sliders_values_are_simulated(session):
    stage = session.study.stage
    value = float(stage.identify["guide.viscous"])
    (figure,) = session.figures("run0", values={"guide.viscous": value})
    same, fitted = (_numbers(figure["models"][k]["y"]) for k in (-1, -2))
    assert np.allclose(same, fitted, atol=1e-6 * np.ptp(fitted))  # single precision
    (figure,) = session.figures("run0", values={"guide.viscous": 2.0 * value})
    assert not np.allclose(_numbers(figure["models"][-1]["y"]), fitted, atol=1e-3 * np.ptp(fitted))
    with pytest.raises(KeyError, match=r"did you mean 'guide\.viscous'"):
        session.figures("run0", values={"guide.viscos": 1.0})


def test_candidates_are_listed_with_what_they_would_change(tmp_path):
    session = Session(Study(problem_of()), tmp_path / "history.json")
    with pytest.raises(ValueError, match="have not been scored yet"):
        session.candidates()
    with pytest.raises(ValueError, match="is being compared"):
        session.where()
    assert not session.study.stages  # a question makes no stage: the thread of the work in hand does
    _ = session.study.stage
    with pytest.raises(ValueError, match="have not been scored yet"):
        session.figures("run0", predict=NAME)
    session.do("score", {})
    session.join()
    listed = session.candidates()
    best = listed["rows"][0]
    assert best["name"] == NAME
    assert best["falls"][OUTPUT] > 50.0
    assert best["what"]
    assert best["causes"]
    assert listed["nothing"] + sum(r["weight"] for r in listed["rows"]) == pytest.approx(1.0)
    (figure,) = session.figures("run0", predict=NAME)
    signal = session.study.compare().of(record="run0")[0]
    rows = np.searchsorted(signal.time, figure["from"] + _numbers(figure["x"]) - 1e-4)
    predicted = _numbers(figure["models"][-1]["y"])
    left = np.sqrt(np.mean((signal.measured[rows] - predicted) ** 2))
    assert left < 0.5 * np.sqrt(np.mean(signal.residual[rows] ** 2))
    (held_out,) = session.figures("run2", predict=NAME)
    assert "predicted" not in [m["style"] for m in held_out["models"]]


def test_other_views_have_numbers(session):
    machine = session.machine()
    assert [n["name"] for n in machine["nodes"]] == ["carriage", "drive", "guide", "spring"]
    assert any("ground" in edge for edge in machine["edges"])
    motion = session.against_motion(OUTPUT)
    assert {"speed", "position", "acceleration"} <= {c["over"] for c in motion["clouds"]}
    shares = {r["regime"]: r["share"] for r in motion["regimes"] if r["place"] == motion["clouds"][0]["place"]}
    assert sum(shares.values()) == pytest.approx(1.0)
    (spectrum,) = session.spectra("run0")
    assert len(spectrum["frequency"]) == len(spectrum["residual"]) == len(spectrum["coherence"])
    (response,) = spectrum["responses"]
    assert response["input"] == "drive.force"
    line = int(np.argmin(np.abs(np.array(spectrum["frequency"]) - 2.3)))  # where the force was excited
    assert response["model"][line] == pytest.approx(response["measured"][line], rel=0.1)
    assert len(response["coherence"]) == len(spectrum["frequency"])
    assert len(session.table()) == 3
    assert session.where()


def test_every_kind_that_is_listed_has_its_law(session):
    shown = session.kind("coulomb_friction")
    assert shown["law"]
    assert shown["picture"].startswith("<?xml")
    assert session.kind("unknown_force")["picture"] == ""
    with pytest.raises(KeyError, match="there is no effect 'coulom'"):
        session.kind("coulom")


def test_the_missing_force_is_drawn_and_kept_as_a_curve(tmp_path):
    session = Session(Study(problem_of()), tmp_path / "history.json")
    session.begin("compare", lambda: session.study.stage)
    session.join()
    assert session.force("guide") == {"places": [p.name for p in session.study.stage.system.places], "known": False}
    _done(session, "force", where="guide")
    force = session.force("guide")
    best = force["over"][0]
    assert best["regressor"] == "speed"
    assert force["determined"] > 0.5
    jump = np.interp([-0.15, 0.25], best["curve"]["x"], best["curve"]["y"])
    # 6 N either way; the recalibrated viscous friction has taken some of it, about a tenth at these speeds
    assert jump[0] - jump[1] == pytest.approx(12.0, rel=0.25)
    assert best["laws"][0]["name"] == "Stribeck"  # it falls with speed, as the viscous friction is now too large
    json.dumps(force)
    before = session.study.stage.rmse("validate")[OUTPUT]
    _done(session, "add_curve", where="guide", over="speed")
    assert session.study.stage.rmse("validate")[OUTPUT] < 0.5 * before
    again = Study(problem_of())
    restore(again, session.history)
    assert again.stage.rmse("validate") == session.study.stage.rmse("validate")
    session.do("add_curve", {"where": "guide", "over": "colour"})
    session.join()
    assert "there is no free curve over 'colour' at 'guide': its arguments are" in session.state()["error"]
    session.do("force", {"where": "gide"})
    session.join()
    assert "the model has no place 'gide'; did you mean 'guide'" in session.state()["error"]


def test_another_prior_moves_the_fit_and_is_kept(tmp_path):
    session = Session(Study(problem_of()), tmp_path / "history.json")
    session.begin("compare", lambda: session.study.stage)
    session.join()
    given = session.state()["parameters"][0]
    assert given["prior"] == {"value": 30.0, "std": 5.0}
    _done(session, "set_prior", name="guide.viscous", value=80.0, std=1e-3)
    moved = session.state()["parameters"][0]
    assert moved["value"] == pytest.approx(80.0, abs=0.01)
    assert moved["prior"] == {"value": 80.0, "std": 1e-3}
    again = Study(problem_of())
    restore(again, session.history)
    assert again.stage.rmse("validate") == session.study.stage.rmse("validate")
    taken = Study(problem_of())
    replay(taken, session.study.steps)
    assert taken.stage.rmse("validate") == pytest.approx(session.study.stage.rmse("validate"), rel=1e-9)
    for given, told in (
        ({"name": "guide.viscos"}, "is no uncertain parameter of this study; did you mean 'guide.viscous'"),
        ({"name": "guide.viscous", "value": -1.0}, "the value -1 is outside 0 to inf"),
        ({"name": "guide.viscous", "std": 0.0}, "is not positive"),
    ):
        session.do("set_prior", given)
        session.join()
        assert told in session.state()["error"]
        assert len(session.state()["stages"]) == 2


def test_work_that_yields_gives_way(tmp_path):
    session = Session(Study(problem_of()), tmp_path / "history.json")
    begun = threading.Event()

    def work() -> None:
        begun.set()
        for _ in range(3000):  # 30 s, unless it is stopped
            session.study.progress("go on")
            time.sleep(0.01)
        raise AssertionError("nobody stopped it")

    session.begin("score", work, yields=True)
    assert begun.wait(30.0)
    with pytest.raises(Busy):
        session.begin("score", work, yields=True)
    session.begin("compare", lambda: session.study.stage)
    session.join()
    assert session.state()["error"] == ""
    assert len(session.state()["stages"]) == 2


def test_work_in_the_background_rests_while_a_figure_is_asked_for(tmp_path):
    session = Session(Study(problem_of()), tmp_path / "history.json")
    steps, begun = [], threading.Event()

    def work() -> None:
        for k in range(400):
            session.study.progress(f"step {k}")
            steps.append(time.monotonic())
            begun.set()
            time.sleep(0.005)

    session.begin("score", work, yields=True)
    assert begun.wait(30.0)
    with session.giving_way.request():
        time.sleep(0.05)  # until the step in hand is finished
        asked = time.monotonic()
        time.sleep(0.4)
        answered = time.monotonic()
    assert not [s for s in steps if asked < s < answered]
    time.sleep(1.0)
    assert steps[-1] > answered  # and goes on after it
    session.stop()
    session.join()


def test_no_request_holds_the_work_for_ever():
    gate = GivingWay()
    with gate.request():
        begun = time.monotonic()
        gate.rest(patience=0.2)
        assert 0.15 < time.monotonic() - begun < 5.0
    begun = time.monotonic()
    gate.rest(patience=5.0)
    assert time.monotonic() - begun < 1.0


def test_each_column_of_pixels_has_its_spike(session):
    values, columns = np.zeros(90_000), 1500
    spikes = np.arange(30, values.size, 60)  # one in each column
    values[spikes] = np.where(np.arange(spikes.size) % 2, 1.0, -1.0)
    rows = extreme_rows(values, rows_for(columns))
    assert rows.size <= 2 * columns + 2
    assert set(spikes) <= set(rows)
    few, many = (_numbers(session.figures("run1", columns=c)[0]["x"]).size for c in (100, 4000))
    assert few < many == session.study.compare().of(record="run1")[0].time.size


def test_one_piece_of_work_at_a_time_and_it_can_be_stopped(tmp_path):
    session = Session(Study(problem_of()), tmp_path / "history.json")
    gate = threading.Event()

    def work() -> None:
        gate.wait(30.0)
        session.study.progress("never shown")
        raise AssertionError("progress after a stop must end the work")

    session.begin("wait", work)
    with pytest.raises(Busy, match="wait until 'wait' is done"):
        session.do("score", {})
    session.stop()
    gate.set()
    session.join()
    assert session.state()["error"].startswith("stopped")
    session.begin("compare", lambda: session.study.stage)
    session.join()
    assert len(session.state()["stages"]) == 2


def test_a_step_that_ends_while_the_state_is_read_is_told_as_news(session, monkeypatch):
    ended = threading.Event()

    def end_the_step(unit):
        ended.set()
        session.join()
        return unit_text(unit)

    session.begin("wait", ended.wait)
    with monkeypatch.context() as patch:
        patch.setattr("discrepancy.workbench.session.unit_text", end_the_step)
        state = session.state()
    assert state["doing"] is not None  # what was read of the stages may be older than the end of the step
    assert state["version"] < session.version
    assert session.state()["doing"] is None


def test_a_step_that_fails_says_why_and_changes_nothing(session):
    before = session.state()["stages"]
    session.do("add", {"effect": "coulomb_friction@gide"})
    session.join()
    assert "'coulomb_friction@gide' is no candidate" in session.state()["error"]
    assert session.state()["stages"] == before
    with pytest.raises(ValueError, match="is no step"):
        session.do("explode", {})
    with pytest.raises(ValueError, match="needs 'effect'"):
        session.do("add", {})


# -------------------------------------------------------------------- the server


class Answer(NamedTuple):
    """What the server said."""

    status: int
    headers: Message
    text: str


@pytest.fixture(scope="module")
def ask(session):
    """A running server; returns a function that asks it."""
    uvicorn = pytest.importorskip("uvicorn", reason="the workbench needs starlette and uvicorn")
    pytest.importorskip("starlette", reason="the workbench needs starlette and uvicorn")
    from discrepancy.workbench.server import application

    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()  # who asks before the server runs is answered when it does
        port = listener.getsockname()[1]
        server = uvicorn.Server(uvicorn.Config(application(session, "secret"), log_level="warning"))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
        thread.start()

        def asked(path: str, body: object = None, *, host: str | None = None, **query: object) -> Answer:
            address = f"http://127.0.0.1:{port}{path}?{urllib.parse.urlencode(query)}"
            data = None if body is None else json.dumps(body).encode()
            request = urllib.request.Request(address, data, {"Host": host} if host else {})
            try:
                with urllib.request.urlopen(request, timeout=60) as found:
                    return Answer(found.status, found.headers, found.read().decode())
            except urllib.error.HTTPError as error:
                return Answer(error.code, error.headers, error.read().decode())

        yield asked
        server.should_exit = True
        thread.join(20.0)


def test_without_the_token_nothing_is_answered(ask):
    for path in ("/", "/state", "/candidates", "/table"):
        assert ask(path).status == 403
        assert ask(path, token="guess").status == 403
    for path in ("/do", "/figures", "/export", "/stop"):
        assert ask(path, {"action": "undo"}).status == 403


@pytest.mark.parametrize("host", ["example.org", "192.168.1.7:8000", "127.0.0.1.example.org"])
def test_other_hosts_are_refused(ask, host):
    assert ask("/", token="secret", host=host).status == 400


def test_the_page_is_whole_and_reaches_nothing_outside(ask):
    page = ask("/", token="secret")
    assert page.status == 200
    assert "default-src 'none'" in page.headers["content-security-policy"]
    assert "vtsdtZoom" in page.text
    assert "leeoniya/uPlot" in page.text
    assert "wb.candidates = " in page.text
    assert not re.search(r"/\*[\w/]+\.(js|css)\*/", page.text)


def test_the_server_answers_with_the_sessions_values(ask, session):
    state = json.loads(ask("/state", token="secret", since=-1).text)
    assert state["stages"] == json.loads(json.dumps(session.state()["stages"]))
    figures = json.loads(ask("/figures", {"record": "run1", "start": None}, token="secret").text)
    assert figures == json.loads(json.dumps(session.figures("run1")))
    wrong = ask("/do", {"action": "explode"}, token="secret")
    assert wrong.status == 400
    assert "is no step" in wrong.text
    wrong = ask("/export", {"what": "script"}, token="secret")
    assert "needs the study file" in wrong.text


def test_the_model_is_exported_beside_the_history(ask, session):
    written = json.loads(ask("/export", {"what": "model"}, token="secret").text)["written"]
    assert written == [str(session.history.with_name("model.json"))]
    from multibody import Model

    assert "coulomb_friction.guide" in Model.load(written[0]).components


def test_a_stage_travels_with_its_effects_and_sensor_errors(session, tmp_path):
    pytest.importorskip("fmpy", reason="needs fmpy: pip install 'vtsdt[fmi]'")
    from multibody import Model
    from multibody.fmi.compiler import c_compiler
    from multibody.fmi.component import Fmu

    if c_compiler() is None:
        pytest.skip("needs a C compiler")
    time = np.linspace(0.0, 0.2, 21)
    given = {"drive.force": (time, 60.0 * np.sin(30.0 * time))}
    friction, offset = session.study.stage, session.study.branches()[0].stages[-1]
    for stage, told in ((friction, "coulomb_friction.guide"), (offset, "sensor.carriage.position")):
        system = stage.machine.build()
        assert any(n.startswith(told) for n in system.parameter_names)
        model = Model("read back")
        plant = model.add("plant", Fmu(system.to_fmu(tmp_path / "stage.fmu", fmi_version="2.0")))
        model.input("drive.force", plant.drive_force)
        own = system.simulate(0.2, times=time, inputs=given)
        read = model.build().simulate(0.2, times=time, inputs=given)
        for name in system.output_names:
            other = read[f"plant.{name.replace('.', '_')}"]
            assert np.allclose(other, own[name], atol=1e-4 * np.ptp(own[name])), name


def test_what_cannot_be_opened_is_told(tmp_path):
    with pytest.raises(StudyError, match=r"there is no history\.json in this folder"):
        open_session(tmp_path)
    history = tmp_path / "history.json"
    history.write_text("{}", encoding="utf-8")
    with pytest.raises(StudyError, match="its study file is not where it was"):
        open_session(history)


def test_a_page_that_waits_for_news_is_let_go_when_the_command_ends(tmp_path):
    session = Session(Study(problem_of()), tmp_path / "history.json")
    waiting = threading.Thread(target=session.wait, args=(session.version, 60.0), daemon=True)
    waiting.start()
    session.close()
    waiting.join(10.0)
    assert not waiting.is_alive()
