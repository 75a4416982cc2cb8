"""`vtsdt follow` on a folder and on a broker: files written in parts, twice, out of order, restarted."""

from __future__ import annotations

import calendar
import getpass
import gzip
import json
import os
import shutil
import socket
import subprocess
import sys
import threading
import time
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import numpy as np
import pytest

from discrepancy.rigs.axis import make_axis
from operation.follow.command import study_priors
from operation.follow.follower import Follower, Taken, record_time
from operation.follow.judge import Judged, StudyJudge
from operation.follow.notify import NotDelivered, deliver
from operation.follow.settings import Alarms, FollowSettings, read_settings
from operation.sources.folder import FolderSource
from operation.sources.mqtt import MqttAddress, MqttInbox, SourceError
from operation.store.judgement import Judgement, Quantity
from operation.store.store import Store
from vtsdt.cli import main

BROKER = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin")


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study of the virtual axis with five recordings."""
    path = make_axis(tmp_path_factory.mktemp("axis"), seed=5, trips=5)
    with path.open("a") as stream:
        stream.write('\n[follow]\nmachine = "axis 5"\nchecks = false\nvirtual = ["carriage.velocity"]\n')
    return path


def recordings(study: Path) -> list[Path]:
    return sorted(study.parent.glob("*.csv.gz"))


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def test_a_file_is_offered_when_it_has_stopped_growing(tmp_path: Path) -> None:
    clock = Clock()
    source = FolderSource(folder=tmp_path, patterns=("*.csv",), settle=2.0, clock=clock)
    growing, whole = tmp_path / "b.csv", tmp_path / "a.csv"
    (tmp_path / ".hidden.csv").write_text("x")
    (tmp_path / "c.csv.part").write_text("x")
    whole.write_text("whole")
    os.utime(whole, (2e9, 2e9))  # a clock that was wrong
    growing.write_text("t,")
    assert source.poll() == []
    clock.now = 1.5
    growing.write_text("t,y\n")
    assert source.poll() == []
    clock.now = 2.1
    assert source.poll() == [whole]
    clock.now = 3.6
    assert source.poll() == [growing]
    assert source.poll() == []
    assert source.all_offered
    growing.write_text("t,y\n1,2\n")  # goes on after all: offered again
    clock.now = 4.0
    assert source.poll() == []
    clock.now = 6.1
    assert source.poll() == [growing]
    whole.unlink()
    assert source.poll() == []


def test_the_time_of_a_record_comes_from_its_name_or_its_file(tmp_path: Path) -> None:
    path = tmp_path / "trip_20260301-080000.csv"
    path.write_text("x")
    os.utime(path, (1000.0, 1000.0))
    assert record_time(path, "%Y%m%d-%H%M%S") == 1772352000.0
    assert record_time(path, "") == 1000.0
    assert record_time(path, "%Y/%m/%d") == 1000.0


def test_records_twice_out_of_order_and_broken_ones(study: Path, tmp_path: Path) -> None:
    settings = replace(read_settings(study), stamp="%Y-%m-%d")
    files = recordings(study)
    order = [3, 0, 4, 1, 2]
    with Store(tmp_path / "a") as store, Store(tmp_path / "b") as other:
        for target, numbers in ((store, range(5)), (other, order)):
            judge = StudyJudge(study, settings)
            follower = Follower(judge=judge, store=target, settings=settings, clock=lambda: 2e9)
            for k in numbers:
                copy = tmp_path / f"{target.folder.name}-2026-03-{k + 1:02d}.csv.gz"
                shutil.copy(files[k], copy)
                assert follower.take(copy).new
        again = tmp_path / "again-2026-05-01.csv"  # the same content, renamed and not compressed
        again.write_bytes(gzip.decompress(files[0].read_bytes()))
        assert not follower.take(again).new
        cut = tmp_path / "cut-2026-03-09.csv.gz"
        cut.write_bytes(files[0].read_bytes()[:2000])
        taken = follower.take(cut)
        assert taken.new
        assert taken.refused
        one, two = store.judgements("axis 5"), [j for j in other.judgements("axis 5") if not j.refused]
        assert [j.at for j in one] == [j.at for j in two]
        for a, b in zip(one, two, strict=True):
            assert a.quantities == b.quantities
        friction = one[0].quantities["guide.viscous"]
        truth = json.loads((study.parent / "truth.json").read_text())["perturbed"]["guide.viscous"]["value"]
        assert abs(friction.value - truth) < 4.0 * friction.std
        assert "largest carriage.velocity" in one[0].quantities
        assert taken.state.records == 5
        assert taken.state.refused == 1


def _stamped(path: Path, at: float) -> Judged:
    """Judge by the name alone: friction of 20 N with a deviation of 1 N."""
    value = 20.0 + float(np.random.default_rng(int(path.stem.split("-")[0])).standard_normal())
    quantities = {"friction": Quantity(value=value, std=1.0, unit="N", kind="parameter")}
    return Judged(Judgement(key=path.name, name=path.name, at=at, quantities=quantities))


def test_clocks_that_jump_forget_nothing_and_change_nothing(tmp_path: Path) -> None:
    """The recorder's clock jumps to 2036 and back to 1970, then the computer's own stands in 1970."""
    settings = FollowSettings(machine="m", stamp="%Y%m%d", keep_records=200 * 86400.0)
    begin, day = calendar.timegm((2026, 3, 1, 0, 0, 0)), 86400.0
    clock = Clock()
    with Store(tmp_path / "store") as store:
        follower = Follower(judge=_stamped, store=store, settings=settings, clock=clock)

        def take(number: int, stamp: str) -> Taken:
            path = tmp_path / f"{number}-{stamp}.csv"
            path.write_text("x")
            clock.now = begin + number * day + 3600.0
            return follower.take(path)

        for k in range(40):
            assert take(k, time.strftime("%Y%m%d", time.gmtime(begin + k * day))).clock == ""
        ahead = take(40, "20360301")
        assert "stamped 2036-03-01 00:00:00, ahead of this computer's clock: taken as recorded now" in ahead.clock
        assert ahead.state.last == begin + 40 * day + 3600.0
        assert ahead.state.records == 41  # those of before are not older than 200 days
        behind = take(41, "19700102")
        assert behind.clock == ""
        kept = follower.state(now=clock.now)
        assert kept.word == "as expected"
        assert kept.last == ahead.state.last
        clock.now = 0.0
        path = tmp_path / "42-20260412.csv"
        path.write_text("x")
        late = follower.take(path)
        assert late.clock == ""  # the computer's clock lies before the records kept: it is the wrong one
        assert late.state.last == begin + 42 * day


def test_the_command_judges_a_folder_and_history_tells_it(study: Path, tmp_path: Path, capsys) -> None:
    inbox, out = tmp_path / "inbox", tmp_path / "out"
    inbox.mkdir()
    for path in recordings(study)[:2]:
        shutil.copy(path, inbox)
    words = [
        "follow",
        str(study),
        "--source",
        str(inbox),
        "--out",
        str(out),
        "--once",
        "--settle",
        "0",
        "--poll",
        "0.01",
    ]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "identify_01.csv.gz: as expected" in said
    assert "axis 5: as expected" in said
    assert main(words) == 0
    assert "identify_01.csv.gz: known" in capsys.readouterr().out
    assert main(["history", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["axis 5"]
    assert found["records"] == 2
    assert found["quantities"]["guide.viscous"]["unit"] == "N*s/m"
    assert main(["history", str(out), "--note", "guide cleaned", "--at", "2026-03-01", "--new-reference"]) == 0
    assert main(["history", str(out)]) == 0
    assert "2026-03-01 note: guide cleaned" in capsys.readouterr().out
    assert main(["history", str(out), "--csv", str(tmp_path / "h.csv")]) == 0
    assert (tmp_path / "h.csv").read_text().startswith("machine,name,at,quantity")
    for wrong, text in (
        (["history", str(tmp_path / "none")], "there is no history"),
        (["history", str(out), "--machine", "axis 6"], "axis 5"),
        (["history", str(out), "--note", "x", "--at", "yesterday"], "2026-03-01T08:00"),
        (["follow", str(study), "--source", str(tmp_path / "no"), "--out", str(out)], "no such folder"),
        (["follow", str(study), "--source", str(out), "--out", str(out)], "lies in --out"),
        (["follow", str(study), "--source", "mqtt://h", "--out", str(out)], "names no topic"),
    ):
        assert main(wrong) == 2
        assert text in capsys.readouterr().err


def test_an_alarm_goes_to_a_command_and_a_web_address(tmp_path: Path) -> None:
    got: list[bytes] = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            got.append(self.rfile.read(int(self.headers["Content-Length"])))
            self.send_response(200)
            self.end_headers()

        def log_message(self, *args: object) -> None:
            pass

    server = HTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    file = tmp_path / "said.json"
    code = f"import sys; open({str(file)!r}, 'w').write(sys.stdin.read())"
    alarms = Alarms(command=(sys.executable, "-c", code), webhook=f"http://127.0.0.1:{server.server_port}/")
    message = {"machine": "lift; rm -rf $HOME", "subject": "friction"}
    assert deliver(alarms, message)
    server.shutdown()
    assert json.loads(file.read_text()) == json.loads(got[0]) == message
    server.server_close()
    with pytest.raises(NotDelivered, match=r"exit code 3.*127\.0\.0\.1"):
        deliver(replace(alarms, command=(sys.executable, "-c", "raise SystemExit(3)")), message)
    assert not deliver(Alarms(), message)


def test_addresses_of_brokers() -> None:
    address = MqttAddress.parse("mqtts://me@broker.example/lifts/+/records/#")
    assert (address.port, address.secure, address.user, address.topic) == (8883, True, "me", "lifts/+/records/#")
    with pytest.raises(SourceError, match=r"holds a password.*VTSDT_MQTT_PASSWORD"):
        MqttAddress.parse("mqtt://me:secret@host/topic")
    with pytest.raises(SourceError, match="names no host; names no topic"):
        MqttAddress.parse("mqtt://")


def _broker(folder: Path, port: int) -> subprocess.Popen[bytes]:
    config = folder / "mosquitto.conf"
    config.write_text(
        f"listener {port} 127.0.0.1\nallow_anonymous true\npersistence true\npersistence_location {folder}/\n"
        f"autosave_interval 1\nuser {getpass.getuser()}\n"
    )
    os.chmod(folder, 0o777)
    assert BROKER is not None
    command = [BROKER, "-c", str(config)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    for _ in range(200):
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return process
        time.sleep(0.05)
    raise RuntimeError("the broker does not listen")


def _wait(condition, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "nothing happened for a minute"
        time.sleep(0.05)


@pytest.mark.skipif(BROKER is None, reason="the broker mosquitto is not installed (apt-get install mosquitto)")
def test_no_message_is_lost_when_the_broker_is_restarted(tmp_path: Path) -> None:
    paho = pytest.importorskip("paho.mqtt.client", reason="the extra [mqtt] is not installed")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    folder = tmp_path / "broker"
    folder.mkdir()
    broker = _broker(folder, port)
    address = MqttAddress(host="127.0.0.1", port=port, topic="axis/#")
    sender = paho.Client(paho.CallbackAPIVersion.VERSION2, client_id="rig", clean_session=False)
    sender.reconnect_delay_set(1, 1)
    sender.connect("127.0.0.1", port)
    sender.loop_start()
    inbox = tmp_path / "inbox"
    try:
        with MqttInbox(address, inbox, "twin") as twin:
            assert twin.connected.wait(30.0)
            for k in range(5):
                sender.publish(f"axis/trip{k}", f"t,y\n{k},1\n", qos=1).wait_for_publish(30.0)
            _wait(lambda: len(list(inbox.glob("trip*.csv"))) == 5)
            broker.terminate()
            broker.wait()
            broker = _broker(folder, port)
            for k in range(5, 8):
                sender.publish(f"axis/trip{k}", f"t,y\n{k},1\n", qos=1)
            _wait(lambda: len(list(inbox.glob("trip*.csv"))) == 8)
            sender.publish("axis/trip0", "t,y\n0,1\n", qos=1)  # once more
        # the twin is away: the broker keeps what comes
        sender.publish("axis/trip8", "t,y\n8,1\n", qos=1).wait_for_publish(30.0)
        with MqttInbox(address, inbox, "twin"):
            _wait(lambda: len(list(inbox.glob("trip*.csv"))) == 9)
        names = sorted(p.name[:5] for p in inbox.iterdir())
        assert names == [f"trip{k}" for k in range(9)]
        assert next(inbox.glob("trip3-*.csv")).read_text() == "t,y\n3,1\n"
    finally:
        sender.disconnect()
        sender.loop_stop()
        broker.terminate()
        broker.wait()


def test_what_the_other_machines_say_is_the_prior_of_a_new_one(study: Path, tmp_path: Path, capsys) -> None:
    inbox, out, asked = tmp_path / "inbox", tmp_path / "out", study.with_name("asked.toml")
    inbox.mkdir()
    shutil.copy(recordings(study)[0], inbox)
    text = study.read_text(encoding="utf-8").replace("[follow]\n", "[follow]\nfleet_prior = true\n")
    asked.write_text(text, encoding="utf-8")
    others = np.array([60.0, 62.0, 64.0, 66.0, 68.0])

    def add(machine: int) -> None:
        friction = Quantity(value=float(others[machine]), std=0.5, unit="N*s/m", kind="parameter")
        with Store(out) as store:
            key = f"{machine}"
            store.add(f"axis {machine}", Judgement(key=key, name=key, at=0.0, quantities={"guide.viscous": friction}))

    def followed() -> tuple[float, float, str]:
        words = f"follow {asked} --source {inbox} --out {out} --once --settle 0 --poll 0.01 --machine new --debug"
        assert main(words.split()) == 0
        told = capsys.readouterr().out
        assert main(["history", str(out), "--json"]) == 0
        found = json.loads(capsys.readouterr().out)["new"]["quantities"]["guide.viscous"]
        return found["value"], found["std"], told

    def expected(prior: tuple[float, float]) -> tuple[float, float]:
        with Store(out) as store:
            own = store.judgements("new")[0].quantities["guide.viscous"]
        weights = np.array([own.std**-2, prior[1] ** -2])
        return float(weights @ [own.value, prior[0]] / weights.sum()), float(weights.sum() ** -0.5)

    for machine in range(4):
        add(machine)
    value, std, told = followed()
    assert "too few to say anything" in told
    assert (value, std) == pytest.approx(expected(study_priors(study)["guide.viscous"]))
    add(4)
    value, std, told = followed()
    assert "the other machines give the priors of guide.viscous" in told
    # Machines that are equally well known: their mean, its error and the spread between them in closed form.
    spread = np.sqrt(np.var(others, ddof=1) - 0.5**2)
    prior = others.mean(), np.hypot(spread, np.std(others, ddof=1) / np.sqrt(5))
    assert (value, std) == pytest.approx(expected(prior), rel=1e-6)
