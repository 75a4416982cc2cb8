"""What a unit's process answers: arrays, numbers and texts as bytes, of which nothing is ever run."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

__all__ = ["ANSWER", "FAILURE", "PIECE", "PULSE", "REFUSAL", "packed", "unpacked"]

#: First byte of a message: an answer; the unit refuses; the work fails, for which the unit is not to blame; a piece of
#: an answer, after which the process waits to be asked to go on; the process is at work.
ANSWER, REFUSAL, FAILURE, PIECE, PULSE = b"+", b"-", b"!", b"p", b"~"


def packed(value: Any) -> bytes:
    """Return arrays of float64, numbers, texts, None, and tuples, lists and dicts of these as bytes.

    Examples
    --------
    >>> unpacked(packed({"states": np.array([[1.0, 2.0]]), "end": [3.0, "explicit"]}))
    {'states': array([[1., 2.]]), 'end': [3.0, 'explicit']}
    """
    arrays: list[np.ndarray] = []

    def plain(part: Any) -> Any:
        if isinstance(part, np.ndarray):
            arrays.append(np.ascontiguousarray(part, dtype=np.float64))
            return {"array": list(part.shape)}
        if isinstance(part, dict):
            return {"dict": {name: plain(inner) for name, inner in part.items()}}
        if isinstance(part, list | tuple):
            return [plain(inner) for inner in part]
        return part.item() if isinstance(part, np.generic) else part

    head = json.dumps(plain(value)).encode()
    return b"".join([len(head).to_bytes(8, "little"), head, *(a.tobytes() for a in arrays)])


def unpacked(data: bytes) -> Any:
    """Return what `packed` was given; tuples come back as lists.

    Raises
    ------
    ValueError
        If the bytes are something else.
    """
    end = 8 + int.from_bytes(data[:8], "little")

    def whole(part: Any) -> Any:
        nonlocal end
        if isinstance(part, list):
            return [whole(inner) for inner in part]
        if not isinstance(part, dict):
            return part
        if "dict" in part:
            return {name: whole(inner) for name, inner in part["dict"].items()}
        shape = tuple(map(int, part["array"]))
        begin, end = end, end + 8 * int(np.prod(shape))
        return np.frombuffer(data[begin:end]).reshape(shape).copy()

    return whole(json.loads(data[8:end]))
