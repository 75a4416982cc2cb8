"""The functions of a universal file (UFF, dataset 58), each with its own abscissa."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from estimation.files.faults import RecordError
from estimation.files.optional_library import library
from estimation.files.own_times import table_from_channels
from estimation.files.table import FileTable, TableRequest

__all__ = ["read_uff"]

#: Function type of a time response in dataset 58.
_TIME_RESPONSE = 1
_DIRECTIONS = {1: "+X", 2: "+Y", 3: "+Z", -1: "-X", -2: "-Y", -3: "-Z", 4: "+RX", 5: "+RY", 6: "+RZ", 0: ""}


def read_uff(path: Path, request: TableRequest) -> FileTable:
    """Read time responses of a universal file; see `estimation.files.read_table.read_table`.

    A function is called by its first identification line, with node and direction where that is not unique.
    """
    pyuff = library("pyuff", path, "a universal file", "uff")
    try:
        file = pyuff.UFF(str(path))
        sets = [file.read_sets(int(k)) for k in np.flatnonzero(np.asarray(file.get_set_types()) == 58)]
    except Exception as error:  # the reader raises many kinds on damaged files
        raise RecordError([f"{path.name}: is not a readable universal file ({error}): export it again"]) from error
    responses = [s for s in sets if int(s.get("func_type", 0)) == _TIME_RESPONSE]
    if not responses:
        raise RecordError([f"{path.name}: holds no time response (dataset 58, function type 1)"])
    first = [str(s.get("id1", "")).strip() for s in responses]
    by_name: dict[str, Any] = {}
    for place, (s, text) in enumerate(zip(responses, first, strict=True)):
        node = f"{s.get('rsp_node', 0)}{_DIRECTIONS.get(int(s.get('rsp_dir', 0)), '')}"
        name = text if text and text.upper() != "NONE" and first.count(text) == 1 else f"{text} {node}".strip()
        by_name[name if name not in by_name else f"{name} ({place + 1})"] = s
    units = {name: _unit(str(s.get("ordinate_axis_units_lab", ""))) for name, s in by_name.items()}

    def get(name: str) -> tuple[np.ndarray, np.ndarray, int | None]:
        s = by_name[name]
        return np.asarray(s["data"]), np.asarray(s["x"], dtype=float), None

    return table_from_channels(path, list(by_name), request, get, units, "function")


def _unit(text: str) -> str:
    return "" if text.strip().upper() in ("", "NONE") else text.strip()
