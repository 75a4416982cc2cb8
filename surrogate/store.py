"""Response surfaces as JSON files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from .polynomial import Terms
from .quality import TestQuality
from .response_surface import ResponseSurface
from .space import DesignSpace

__all__ = ["load_surface", "save_surface"]

_SCHEMA = 1
_NEEDED = ("schema", "space", "exponents", "coefficients", "response", "unit")


def save_surface(surface: ResponseSurface, path: str | Path) -> None:
    """Write a surface; numbers keep all their digits."""
    content: dict[str, Any] = {
        "schema": _SCHEMA,
        "kind": "polynomial response surface",
        "response": surface.response,
        "unit": surface.unit,
        "space": surface.space.to_dict(),
        "terms": list(surface.term_names),
        "exponents": [list(row) for row in surface.terms.exponents],
        "coefficients": surface.coefficients.tolist(),
    }
    if surface.train_points is not None and surface.train_responses is not None:
        content["train"] = {
            "points": surface.train_points.tolist(),
            "responses": surface.train_responses.tolist(),
        }
    if surface.test_quality is not None:
        content["test_quality"] = {
            key: getattr(surface.test_quality, key) for key in TestQuality.__dataclass_fields__
        }
    Path(path).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def load_surface(path: str | Path) -> ResponseSurface:
    """Read a surface.

    Raises
    ------
    ValueError
        Naming the file and what is wrong with it.
    """
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: not a JSON file ({error})") from error
    if not isinstance(content, dict):
        raise ValueError(f"{path}: expected an object with {', '.join(_NEEDED)}")
    missing = [key for key in _NEEDED if key not in content]
    if missing:
        raise ValueError(f"{path}: not a response surface; it lacks {', '.join(missing)}")
    if content["schema"] != _SCHEMA:
        raise ValueError(f"{path}: schema {content['schema']} is not known here (expected {_SCHEMA})")
    try:
        train = content.get("train")
        tested = content.get("test_quality")
        space = DesignSpace.from_dict(content["space"])
        points = None if train is None else space.points(train["points"], what="train points")
        responses = None if train is None else np.array(train["responses"], dtype=float)
        if points is not None and responses is not None and responses.shape != (points.shape[0],):
            raise ValueError(f"{responses.size} train responses for {points.shape[0]} train points")
        return ResponseSurface(
            space=space,
            terms=Terms(tuple(tuple(row) for row in content["exponents"])),
            coefficients=np.array(content["coefficients"], dtype=float),
            response=str(content["response"]),
            unit=str(content["unit"]),
            train_points=points,
            train_responses=responses,
            test_quality=None if tested is None else TestQuality(**tested),
        )
    except KeyError as error:
        raise ValueError(f"{path}: lacks {error}") from error
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error
