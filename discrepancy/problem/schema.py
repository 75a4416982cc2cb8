"""The JSON Schema of a study file, made from the tables that read it: editors complete and check with it."""

from __future__ import annotations

from typing import Any

import msgspec

from discrepancy.problem.tables import (
    BY_RECORD,
    CandidatesTable,
    ClockTable,
    Column,
    ConnectionTable,
    ModelTable,
    OffsetsTable,
    RecordsTable,
    StudyTable,
    Uncertain,
)

__all__ = ["study_schema"]

_STRUCTS = {
    "model": ModelTable,
    "records": RecordsTable,
    "candidates": CandidatesTable,
    "study": StudyTable,
    "offsets": OffsetsTable,
}
#: Tables of names, each of which has an entry.
_NAMED = {"uncertain": Uncertain, "inputs": Column, "outputs": Column}


def study_schema() -> dict[str, Any]:
    """Return the schema of a study file, as JSON Schema of draft 2020-12.

    It knows tables, keys, types and choices.  Whether names are names of the model and files are there only
    `discrepancy.problem.study_file.read_study` and ``vtsdt check`` can say.

    Examples
    --------
    >>> sorted(study_schema()["required"])
    ['model', 'outputs', 'records']
    """
    kinds = (*_STRUCTS.values(), *dict.fromkeys(_NAMED.values()), ClockTable, ConnectionTable)
    _, parts = msgspec.json.schema_components(kinds, ref_template="#/$defs/{name}")
    definitions = {name: _strict(part) for name, part in parts.items()}
    tables: dict[str, Any] = {name: {"$ref": f"#/$defs/{kind.__name__}"} for name, kind in _STRUCTS.items()}
    for name, kind in _NAMED.items():
        entry: list[dict[str, Any]] = [{"$ref": f"#/$defs/{kind.__name__}"}]
        if kind is Column:
            entry.append({"type": "string", "description": "the measured column"})
        definitions[name] = _names(name, entry)
        tables[name] = {"$ref": f"#/$defs/{name}"}
    start: list[dict[str, Any]] = [{"type": "number"}, {"type": "string"}]
    by_record = {
        "type": "object",
        "properties": {BY_RECORD: {"type": "object", "additionalProperties": {"anyOf": start}}},
        "required": [BY_RECORD],
        "additionalProperties": False,
    }
    definitions["initial"] = _names("initial", [*start, by_record])
    definitions["initial"]["properties"] = {"free": {"type": "array", "items": {"type": "string"}}}
    tables["initial"] = {"$ref": "#/$defs/initial"}
    for name, kind in (("clocks", ClockTable), ("connections", ConnectionTable)):
        tables[name] = {"type": "object", "additionalProperties": {"$ref": f"#/$defs/{kind.__name__}"}}
    tables["updating"] = {"type": "object", "description": "read by vtsdt update-gearbox"}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "vtsdt study",
        "description": "Which model is compared with which recordings, and what may be changed to make them agree.",
        "type": "object",
        "properties": tables,
        "required": ["model", "outputs", "records"],
        "additionalProperties": False,
        "$defs": definitions,
    }


def _names(name: str, entry: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the schema of a table of names, whose dots may be quoted or make further tables.

    What has a key ``column`` is an entry, and no further table with a name of that word.
    """
    further = {"$ref": f"#/$defs/{name}", "not": {"required": ["column"]}}
    return {"type": "object", "additionalProperties": {"anyOf": [*entry, further]}}


def _strict(part: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a table without unknown keys, and without null, which TOML does not have."""
    text = " ".join(str(part.get("description", "")).replace("``", "").split())
    properties = {}
    for key, value in part.get("properties", {}).items():
        value = dict(value)
        choices = [each for each in value.get("anyOf", []) if each != {"type": "null"}]
        if len(choices) == 1:
            value = {**{k: v for k, v in value.items() if k != "anyOf"}, **choices[0]}
        if value.get("default", 0) is None:
            del value["default"]
        properties[key] = value
    return {**part, "description": text, "properties": properties, "additionalProperties": False}
