"""Fault data from a virtual gear stage: a classifier trained on it, judged on another virtual rig and on a stand-in.

The purpose of the gearbox paper: a model gives labelled vibration at any speed and load, on which a fault diagnosis is
trained before a machine has failed.  Here the machine is a rig with errors of manufacturing, which the model lacks and
which is called the real stage; like everything here it is synthetic.  The model is taken as the drawings give it,
updated as in the paper, and updated with the errors of manufacturing as parameters.  Run it with

    pip install -e ".[faults]"
    python examples/gear_faults.py --out out/gear-faults

Half an hour on one processor.  What is there already in the folder is not made again.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gearbox import DatasetPlan, Signal, StageParameters, write_dataset
from gearbox.papers.manufacturing_errors import WAYS, RigWithErrors
from gearbox.papers.updating_success import ONE_DESIGN, chain_on_rig, one_load, rig_recordings
from gearbox.signals.mesh_lines import fit_lines

HOUSING = "flexible"
TEETH = (32, 44)
LABELS = ("healthy", "tooth_crack@input_gear", "eccentricity@output_gear", "misalignment", "bearing_outer")
SEVERITIES, SPEEDS, LOADS = (0.5,), (1000.0,), (75.0, 150.0)
#: Recordings of each for training and for judging; the first healthy one at each load is the machine's own reference.
TRAINING, JUDGING = 5, 3
NOISE = 0.3  # m/s², that of the rig's accelerometers
#: The real stage, whose recordings the model is updated by, and another virtual rig without errors.
REAL, OTHER = 1, 2
CHANNELS = tuple(f"a_{seat}_{axis} [m/s**2]" for seat in ("input_seat", "output_seat") for axis in "yz")
TREES, SEED = 400, 0


# -------------------------------------------------------------------- models and data


def models(folder: Path) -> dict[str, dict[str, float]]:
    """Return the parameters of the model before and after updating, by the healthy recordings of the real stage."""
    path = folder / "models.json"
    if path.is_file():
        return dict(json.loads(path.read_text(encoding="utf-8")))
    recordings = rig_recordings(HOUSING, print, manufacturing=1.0, seed=REAL)
    chain = chain_on_rig(HOUSING, one_load(recordings), print, folder / "simulations.jsonl", seed=0, **ONE_DESIGN)
    with chain.runs:
        updated = chain.run()
    way = next(w for w in WAYS if w.what == "errors of manufacturing too, three loads")
    errors = RigWithErrors.of(HOUSING, print, folder / "simulations-errors.jsonl").update(way)
    found = {
        "as drawn": {},
        "updated as in the paper": dict(updated.updated.values),
        "updated with errors of manufacturing": dict(errors.values),
    }
    path.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return found


def data(folder: Path, name: str, seed: int, repeats: int, **changes: Any) -> pd.DataFrame:
    """Return labels and features of a data set, which is written if it is not there."""
    path = folder / f"{name}.csv"
    if not path.is_file():
        plan = DatasetPlan(
            labels=LABELS,
            severities=SEVERITIES,
            speeds=SPEEDS,
            torques=LOADS,
            repeats=repeats,
            noise=NOISE,
            seed=seed,
            housing=HOUSING,
            **changes,
        )
        labels = write_dataset(folder / name, plan, progress=lambda text: print(f"{name}: {text}"))
        rows = []
        for _, row in labels.iterrows():
            recording = pd.read_parquet(folder / name / row["file"])
            rows.append({**row, **features(recording, row["speed_rpm"], row["torque_Nm"], plan.rate)})
        pd.DataFrame(rows).to_csv(path, index=False)
    return pd.read_csv(path)


# -------------------------------------------------------------------- features


def features(recording: pd.DataFrame, speed: float, torque: float, rate: float) -> dict[str, float]:
    """Return what is taken of a recording, in decibels: sizes at mesh orders, sidebands, shaft and bearing lines."""
    f_1 = speed / 60.0
    f_2, mesh = f_1 * TEETH[0] / TEETH[1], f_1 * TEETH[0]
    bearings = StageParameters.paper().bearings
    outer = 0.5 * bearings.elements * (1.0 - bearings.ratio) * f_1
    values: dict[str, float] = {}
    for channel in CHANNELS:
        y = recording[channel].to_numpy()
        y = y - y.mean()
        short = channel.removeprefix("a_").partition(" ")[0]

        def level(frequencies: np.ndarray, y: np.ndarray = y) -> np.ndarray:
            return np.abs(fit_lines(Signal(y, rate, name="y"), frequencies).amplitudes)

        lines = level(mesh * np.arange(1, 5))
        rest = fit_lines(Signal(y, rate, name="y"), mesh * np.arange(1, 9)).residual_rms
        values[f"{short} size"] = decibel(y.std() / torque)
        for k, line in enumerate(lines, start=1):
            values[f"{short} order {k}"] = decibel(line / y.std())
        values[f"{short} off the mesh"] = decibel(rest / y.std())
        for name, f in (("1", f_1), ("2", f_2)):
            around = [m * mesh + k * f for m in (1, 2) for k in (-3, -2, -1, 1, 2, 3)]
            values[f"{short} sidebands of shaft {name}"] = decibel(
                np.sqrt((level(np.array(around)) ** 2).sum()) / y.std()
            )
            values[f"{short} shaft {name}"] = decibel(level(np.array([f, 2.0 * f])).max() / y.std())
        envelope = np.abs(analytic(y))
        envelope = envelope - envelope.mean()
        for name, f in (("shaft 1", f_1), ("shaft 2", f_2), ("outer ring", outer)):
            strong = np.sqrt((level(f * np.arange(1, 4), envelope) ** 2).sum())
            values[f"{short} envelope, {name}"] = decibel(strong / envelope.std())
        values[f"{short} kurtosis"] = float(np.mean(y**4) / np.mean(y**2) ** 2)
    return values


def analytic(y: np.ndarray) -> np.ndarray:
    """Return the analytic signal."""
    from scipy.signal import hilbert

    return np.asarray(hilbert(y))


def decibel(ratio: float) -> float:
    """Return 20 log10 of a ratio."""
    return float(20.0 * np.log10(max(ratio, 1e-12)))


def split(table: pd.DataFrame, relative: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return features and labels; ``relative`` to the machine's own healthy reference at the same speed and load."""
    names = [c for c in table if str(c).startswith(("input_seat", "output_seat"))]
    at = table.groupby(["label", "severity", "speed_rpm", "torque_Nm"]).cumcount()
    reference = (table["label"] == "healthy") & (at == 0)
    values = table[names].copy()
    if relative:
        own = table[reference].set_index(["speed_rpm", "torque_Nm"])[names]
        keys = pd.MultiIndex.from_frame(table[["speed_rpm", "torque_Nm"]])
        values = values - own.loc[keys].to_numpy()
    kept = ~reference
    return values[kept].to_numpy(dtype=float), table.loc[kept, "label"].to_numpy(dtype=str)


# -------------------------------------------------------------------- classifier


def confusion(train: pd.DataFrame, test: pd.DataFrame, relative: bool) -> pd.DataFrame:
    """Return the confusion matrix, true labels by rows, of a random forest trained on one set and judged on another."""
    from sklearn.ensemble import RandomForestClassifier
    from sklearn.metrics import confusion_matrix

    x, y = split(train, relative)
    forest = RandomForestClassifier(TREES, class_weight="balanced", random_state=SEED).fit(x, y)
    unseen, truth = split(test, relative)
    order = [text.partition("@")[0] for text in LABELS]
    return pd.DataFrame(confusion_matrix(truth, forest.predict(unseen), labels=order), index=order, columns=order)


def balanced(matrix: pd.DataFrame) -> float:
    """Return the mean over labels of the share that is right: one in five by chance."""
    counts = matrix.to_numpy(dtype=float)
    return float(np.mean(np.diag(counts) / counts.sum(axis=1)))


def results(folder: Path) -> dict[tuple[str, str, bool], pd.DataFrame]:
    """Return the confusion matrix by training set, test set, and whether features are relative to a healthy record."""
    found: Mapping[str, dict[str, float]] = models(folder)
    trained = {
        name: data(folder, f"train_{k}", 10, TRAINING, parameters=values)
        for k, (name, values) in enumerate(found.items(), start=1)
    }
    tests = {
        "the same virtual stage": data(folder, "test_same", 20, JUDGING),
        "another virtual rig": data(folder, "test_other", 30, JUDGING, rig=OTHER),
        "the real stage": data(folder, "test_real", 40, JUDGING, rig=REAL, manufacturing=1.0),
    }
    matrices = {
        (name, judged, relative): confusion(train, test, relative)
        for name, train in trained.items()
        for judged, test in tests.items()
        for relative in (False, True)
    }
    own = data(folder, "train_real", 50, TRAINING, rig=REAL, manufacturing=1.0)
    for relative in (False, True):
        matrices["recordings of the real stage", "the real stage", relative] = confusion(
            own, tests["the real stage"], relative
        )
    return matrices


def page(matrices: Mapping[tuple[str, str, bool], pd.DataFrame]) -> str:
    """Return the shares that are right and the confusion matrices as Markdown."""
    lines = ["| trained on | judged on | features | right, mean over labels |", "| --- | --- | --- | ---: |"]
    words = {False: "as they are", True: "relative to a healthy record"}
    for (train, test, relative), matrix in matrices.items():
        lines.append(f"| {train} | {test} | {words[relative]} | {100 * balanced(matrix):.0f} % |")
    for (train, test, relative), matrix in matrices.items():
        if test == "the real stage":
            lines += ["", f"Trained on: {train}; judged on the real stage; features {words[relative]}:", ""]
            lines.append("| is ↓, called → | " + " | ".join(matrix.columns) + " |")
            lines.append("| --- |" + " ---: |" * len(matrix.columns))
            lines += [
                f"| {label} | " + " | ".join(map(str, row)) + " |"
                for label, row in zip(matrix.index, matrix.to_numpy(), strict=True)
            ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description="Train a classifier on fault data of a virtual gear stage and judge it."
    )
    parser.add_argument("--out", type=Path, default=Path("out/gear-faults"), help="folder for data sets and results")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    text = page(results(out))
    (out / "confusion.md").write_text(text, encoding="utf-8")
    print(text)
