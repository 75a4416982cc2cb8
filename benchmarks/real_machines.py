"""Diagnoses of machines that others have recorded: what each found, how probable it is, what it predicts; the page.

``VTSDT_DATA=/path/to/data python benchmarks/real_machines.py [--only emps/study] [--keep FILE] [--out FOLDER]``, with
``--page docs/benchmarks/real-machines.md`` to write the page
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from run import commit, machine

from discrepancy.conclusion.sentences import kind_title, percent_words
from multibody.base.quantity_text import quantity_text, two_quantities_text

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "examples"

#: Studies under ``examples`` without ``.toml``: the machine, and the initial model.
STUDIES: dict[str, tuple[str, str]] = {
    "torque_limited_pendulum/study": ("torque-limited pendulum", "viscous friction only"),
    "quanser_qube/study": ("rotary pendulum, balanced", "viscous friction only"),
    "emps/study": ("EMPS axis", "the same friction in both directions"),
    "emps/viscous_only": ("EMPS axis", "viscous friction only"),
    "lead_screw/study": ("lead screw", "viscous friction only"),
    "pendulum/study": ("pendulum, large swings fitted", "viscous friction only"),
    "pendulum/small_swings": ("pendulum, small swings fitted", "viscous friction only"),
}


@dataclass(frozen=True, kw_only=True)
class Run:
    """A diagnosis that ended.

    Parameters
    ----------
    processor, wall : float, s
    code : int
        Exit code.
    commit, date : str
        Of the program, and when it was run.
    diagnosis : dict, optional
        Its ``diagnosis.json``, without what the page does not need.
    peak : float, bytes, optional
        Largest resident memory.
    """

    processor: float
    wall: float
    code: int
    commit: str
    date: str
    diagnosis: dict[str, Any] | None
    peak: float | None = None


def diagnosed(study: str, out: Path) -> Run:
    """Diagnose a study in a process of its own, whose progress is shown."""
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    words = [sys.executable, "-m", "vtsdt", "diagnose", str(EXAMPLES / f"{study}.toml"), "--out", str(out)]
    begun, version = time.monotonic(), commit()
    run = subprocess.Popen(words, env={**os.environ, "PYTHONPATH": path}, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(run.pid, 0)
    run.returncode = os.waitstatus_to_exitcode(status)
    written = out / "diagnosis.json"
    return Run(
        processor=used.ru_utime + used.ru_stime,
        wall=time.monotonic() - begun,
        peak=1024.0 * used.ru_maxrss,
        code=run.returncode,
        commit=version,
        date=time.strftime("%Y-%m-%d"),
        diagnosis=needed(json.loads(written.read_text(encoding="utf-8"))) if written.exists() else None,
    )


def needed(diagnosis: dict[str, Any]) -> dict[str, Any]:
    """Return the entries of a ``diagnosis.json`` that the page shows."""
    names = (
        *("verdict", "sentence", "effects", "stages", "explained_on", "probabilities", "predictive_gain"),
        *("predictive_checks", "checks", "disturbance", "unknown_law", "parameters", "units", "residual", "warnings"),
    )
    return {name: diagnosis[name] for name in names if name in diagnosis}


def page(runs: dict[str, Run]) -> str:
    """Return the page: a table of all, and a section for each study."""
    rows = "\n".join(_row(study, run) for study, run in runs.items())
    sections = "\n\n".join(_section(study, run) for study, run in runs.items())
    dates = sorted({run.date for run in runs.values()})
    return PAGE.format(date=dates[-1], machine=machine(), rows=rows, sections=sections)


def _row(study: str, run: Run) -> str:
    what, model = STUDIES[study]
    said = run.diagnosis
    used = f"{run.processor:.0f} s"
    if said is None:
        return f"| {what} | {model} | no result (exit code {run.code}) | | | | {used} |"
    names = "<br>".join(_name(each) + _at_probability(each) for each in said["effects"]) or _nothing(said)
    errors = "<br>".join(_errors(said))
    return f"| {what} | {model} | {said['verdict']} | {names} | {errors} | {_checks(said)} | {used} |"


def _name(entry: dict[str, Any]) -> str:
    return f"{kind_title(entry['kind'])} at {entry['where']}"


def _at_probability(entry: dict[str, Any]) -> str:
    return f", {percent_words(entry['probability'])}" if "probability" in entry else ", no probability"


def _nothing(said: dict[str, Any]) -> str:
    known = said.get("probabilities")
    return f"nothing, {percent_words(known['nothing'])}" if known else "none"


def _errors(said: dict[str, Any]) -> list[str]:
    """Return the error of each output held out, of the calibrated model and of the last."""
    first, last = said["stages"][min(1, len(said["stages"]) - 1)], said["stages"][-1]
    part = said["explained_on"]
    lines = []
    for name, before in first[part].items():
        after = last[part][name]
        one, other = two_quantities_text(before["rmse"], after["rmse"], said["units"][name])
        lines.append(f"{name} {one} → {other} ({100 * before['nrmse']:.3g} → {100 * after['nrmse']:.3g} %)")
    return lines


def _checks(said: dict[str, Any]) -> str:
    """Return how many of the predictive checks passed."""
    checks = said.get("predictive_checks")
    return f"{sum(c['passed'] for c in checks)} of {len(checks)}" if checks else "none made"


def _section(study: str, run: Run) -> str:
    """Return what a diagnosis says: its sentence, the strengths, what else it could be, and the checks."""
    what, model = STUDIES[study]
    lines = [f"## {what[0].upper()}{what[1:]}: {model}", ""]
    memory = f", {run.peak / 1e9:.1f} GB" if run.peak else ""
    cost = f"{run.processor:.0f} s of processor time{memory}, at {run.commit} on {run.date}"
    lines += [f"`examples/{study}.toml`; {cost}.", ""]
    if run.diagnosis is None:
        return "\n".join([*lines, f"It ended with exit code {run.code} and no result."])
    said = run.diagnosis
    lines += [f"> {said['sentence']}", ""]
    if said["effects"]:
        lines += ["| effect | probability | fitted | what else | gain on blocks left out, nats |"]
        lines += ["| --- | --- | --- | --- | --- |", *(_effect(each, said) for each in said["effects"]), ""]
    models = said.get("probabilities", {}).get("models", [])[:5]
    if models:
        lines += ["The most probable models, of all that were tried:", ""]
        for each in models:
            names = ", ".join(_name(_split(name)) for name in each["effects"]) or "nothing is missing"
            lines += [f"- {names}: {percent_words(each['probability'])}"]
        lines += [""]
    lines += ["| output | held-out error, calibrated → last model | fit | innovations |"]
    lines += ["| --- | --- | --- | --- |"]
    for name, text in zip(said["units"], _errors(said), strict=True):
        check = said.get("checks", {}).get(name)
        lines += [f"| {name} | {text.removeprefix(name + ' ')} | {_fit(check)} | {_innovations(check)} |"]
    failed = [c for c in said.get("predictive_checks", ()) if not c["passed"]]
    if failed:
        worst = sorted(failed, key=lambda c: -abs(c["deviations"] or 0.0))[:3]
        words = "; ".join(f"{c['output']}, {c['what']}: {_deviations(c)}" for c in worst)
        lines += ["", f"Checks that failed: {len(failed)} of {len(said['predictive_checks'])}, most: {words}."]
    return "\n".join(lines)


def _effect(entry: dict[str, Any], said: dict[str, Any]) -> str:
    fitted = ", ".join(
        _value(name, p) for name, p in entry["parameters"].items() if isinstance(p, dict) and "value" in p
    )
    own = f"{entry['kind']}@{entry['where']}"
    known = said.get("probabilities", {}).get("effects", [])
    others: list[dict[str, Any]] = next((e["set"][1:] for e in known if f"{e['kind']}@{e['where']}" == own), [])
    others = others or entry["indistinguishable_from"]
    else_ = "<br>".join(_name(each) + _at_probability(each) for each in others) or "nothing"
    gain = said.get("predictive_gain", {}).get(own)
    gained = f"{gain['gain']:.0f} ± {gain['standard_error']:.0f}" if gain else "not judged"
    probability = _at_probability(entry).removeprefix(", ")
    return f"| {_name(entry)} | {probability} | {fitted} | {else_} | {gained} |"


def _value(name: str, fitted: dict[str, Any]) -> str:
    """Return a fitted parameter with its standard deviation; of a free curve what it is a function of, or its ends."""
    value, unit = fitted["value"], fitted["unit"]
    if isinstance(value, str):
        return f"{name.replace('_', ' ')} {value}"
    if isinstance(value, list):
        ends = " to ".join(quantity_text(v, unit) for v in (value[0], value[-1]))
        return f"{name} from {ends}"
    return f"{name} {quantity_text(value, unit)}" + (
        f" ± {quantity_text(fitted['std'], unit)}" if fitted["std"] else ""
    )


def _split(name: str) -> dict[str, str]:
    kind, _, where = name.partition("@")
    return {"kind": kind, "where": where}


def _fit(check: dict[str, Any] | None) -> str:
    return f"{check['fit_percent']:.1f} %" if check else ""


def _innovations(check: dict[str, Any] | None) -> str:
    """Return what the predictive checks say of an output's innovations."""
    if check is None:
        return "not checked"
    white = "white" if check["innovation_white"] else "not white"
    return f"{white}, {check['size']:.2f} of the size promised, {'even' if check['even'] else 'uneven'}"


def _deviations(check: dict[str, Any]) -> str:
    deviations = check["deviations"]
    return "no number" if deviations is None else f"{abs(deviations):.1f} standard deviations off"


def main() -> int:
    """Diagnose what is not in the file of results yet, and write the page."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", help=f"studies, separated by commas, of: {', '.join(STUDIES)}")
    parser.add_argument("--keep", type=Path, help="file of results: what is in it is not diagnosed again")
    parser.add_argument("--out", type=Path, help="folder for the reports")
    parser.add_argument("--page", type=Path)
    given = parser.parse_args()
    kept: dict[str, Run] = {}
    if given.keep and given.keep.exists():
        for line in given.keep.read_text(encoding="utf-8").splitlines():
            study, entry = json.loads(line)
            kept[study] = Run(**entry)
    asked = given.only.split(",") if given.only else [*STUDIES]
    if unknown := [study for study in asked if study not in STUDIES]:
        parser.error(f"no study {', '.join(unknown)}; there are: {', '.join(STUDIES)}")
    with tempfile.TemporaryDirectory() as temporary:
        for study in asked:
            if study in kept:
                continue
            print(f"=== {study}", flush=True)
            run = kept[study] = diagnosed(study, (given.out or Path(temporary)) / study)
            if given.keep:
                with given.keep.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps([study, asdict(run)]) + "\n")
    if given.page:
        given.page.write_text(page({study: kept[study] for study in STUDIES if study in kept}), encoding="utf-8")
    return 1 if any(run.code for run in kept.values()) else 0


PAGE = """# Real machines: what the program says

Written by `python benchmarks/real_machines.py --keep FILE --page docs/benchmarks/real-machines.md`, which runs `vtsdt
diagnose` on studies of machines that others have recorded (`examples/`), each in a process of its own, and may be
interrupted and continued; last run {date}. What these numbers mean, and what can be said against them:
[Real machines](../howto/real-machines.md). {machine}.

The error is the root mean square on records that were not used to fit, of the calibrated model and of the last one; in
brackets as a share of the measured signal's standard deviation. Fit is 100 % less that share. A gain is that of the
log likelihood of blocks left out in turn, with its standard error.

| machine | initial model | verdict | effects, with probability | held-out error | checks passed | processor |
| --- | --- | --- | --- | --- | --- | --- |
{rows}

{sections}
"""

if __name__ == "__main__":
    sys.exit(main())
