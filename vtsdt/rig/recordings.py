"""Recordings of a virtual lift, written as a rig would write them, with effects hidden in it."""

from __future__ import annotations

import dataclasses
import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from discrepancy.rigs.case import check_folder, write_case, write_json
from discrepancy.rigs.recording import Logger
from multibody.base.progress import Progress, silent
from vtsdt.files.parameters import LiftParameters
from vtsdt.rig import texts as bench_texts
from vtsdt.rig.rails import RailSpectrum
from vtsdt.rig.rig import LiftRig

__all__ = ["drawn_spectrum", "make_configurations", "make_lift"]


def make_lift(
    out: str | os.PathLike[str],
    hide: Sequence[str] = (),
    *,
    rig: LiftRig | None = None,
    parameter_file: str | None = None,
    command: str = "",
    progress: Progress = silent,
    **settings: Any,
) -> Path:
    """Write recordings of the virtual lift into a folder, with the study file and the truth.

    Parameters
    ----------
    out : path
        Folder; made if it is not there.
    hide : sequence of str
        ``KIND`` or ``KIND@WHERE``.
    rig : LiftRig, optional
        The rig; otherwise it is made from ``settings``.
    parameter_file : str, optional
        Parameters of another lift; default: the shipped bench.
    command : str
        For the README.

    Returns
    -------
    Path
        The study file.

    Raises
    ------
    BenchError
        With every impossible setting.
    """
    if Path(out).is_file():
        check_folder(out)
    if rig is None:
        if parameter_file is not None:
            settings["parameters"] = LiftParameters.load(parameter_file)
        rig = LiftRig(**settings)
    case = rig.case(hide, progress)
    own = parameter_file is not None
    texts = {
        "study.toml": bench_texts.study(rig, case, own),
        "README.md": bench_texts.readme(rig, case, command or f"vtsdt bench lift --seed {rig.seed}"),
    }
    if own:
        texts["lift.py"] = bench_texts.BUILDER
    study = write_case(out, case, texts)
    if parameter_file is not None:
        shutil.copyfile(parameter_file, study.with_name("lift.toml"))
    return study


def drawn_spectrum(rig: LiftRig) -> RailSpectrum:
    """Return the spectrum of a configuration's guides: mean 1.4 to 2.6 mm, unevenness 0.2 to 0.6 mm."""
    rng = rig.stream(4)
    return RailSpectrum(mean=float(rng.uniform(1.4e-3, 2.6e-3)), rms_x=float(rng.uniform(0.2e-3, 0.6e-3)))


def make_configurations(
    out: str | os.PathLike[str],
    count: int = 14,
    hide: Sequence[str] = (),
    *,
    rig: LiftRig | None = None,
    parameter_file: str | None = None,
    command: str = "",
    progress: Progress = silent,
) -> list[Path]:
    """Write recordings of one lift with several settings of its guides, each in its own folder.

    Parameters
    ----------
    out, hide, parameter_file, command
        See `make_lift`.
    count : int
        Configurations; the paper has 14.
    rig : LiftRig, optional
        Settings of all configurations; default: ten trips from end to end at 1 kHz.

    Returns
    -------
    list of Path
        The study files.
    """
    rig = rig or LiftRig(only_express=True, logger=Logger(rate=1000.0, fine=4), loads=(0.0,))
    folder, studies, rows = check_folder(out), [], []
    for k in range(1, count + 1):
        one = dataclasses.replace(rig, configuration=k)
        one = dataclasses.replace(one, rails=drawn_spectrum(one))
        name = f"configuration_{k:02d}"

        def report(text: str, number: int = k) -> None:
            progress(f"configuration {number} of {count}: {text}")

        studies.append(
            make_lift(folder / name, hide, rig=one, parameter_file=parameter_file, command=command, progress=report)
        )
        right = 1e3 * np.abs(one.profiles["cabin.right_x"].deviation)
        rows.append(
            {"folder": name, "median_mm": round(float(np.median(right)), 4), "largest_mm": round(float(right.max()), 4)}
        )
    text = bench_texts.configurations_readme([str(r["folder"]) for r in rows], command or "vtsdt bench lift")
    (folder / "README.md").write_text(text, encoding="utf-8")
    write_json(
        folder / "truth.json",
        {"synthetic": True, "machine": "lift", "seed": int(rig.seed), "cabin.right_x": rows},
    )
    return studies
