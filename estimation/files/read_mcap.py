"""The messages of a robot's log: MCAP files and ROS bags, each field at its own rate."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from estimation.files.faults import RecordError
from estimation.files.optional_library import library
from estimation.files.own_times import table_from_channels
from estimation.files.table import FileTable, TableRequest

__all__ = ["read_bag", "read_mcap"]


def read_mcap(path: Path, request: TableRequest) -> FileTable:
    """Read fields of the messages in an MCAP file; see `estimation.files.read_table.read_table`.

    A field is called ``/topic.field``, an element of an array ``/topic.field[0]``.  The time of a sample is the stamp
    in the message's header, else the time at which it was logged.  Messages are JSON, or ROS 2 messages (CDR).
    """
    reader = library("mcap.reader", path, "an MCAP file", "ros")

    def messages() -> Iterator[tuple[str, int, Any]]:
        decoders: dict[int, Any] = {}
        with path.open("rb") as stream:
            for schema, channel, message in reader.make_reader(stream).iter_messages():
                if channel.message_encoding == "json":
                    yield channel.topic, message.log_time, json.loads(message.data)
                elif channel.message_encoding == "cdr" and schema is not None:
                    if channel.schema_id not in decoders:
                        decoders[channel.schema_id] = _decoder(path, schema)
                    yield channel.topic, message.log_time, decoders[channel.schema_id](message.data)

    return _table(path, request, messages, "an MCAP file")


def read_bag(path: Path, request: TableRequest) -> FileTable:
    """Read fields of the messages in a ROS 1 bag, named as in `read_mcap`."""
    rosbags = library("rosbags.highlevel", path, "a ROS bag", "ros")

    def messages() -> Iterator[tuple[str, int, Any]]:
        with rosbags.AnyReader([path]) as bag:
            for connection, stamp, raw in bag.messages():
                yield connection.topic, stamp, bag.deserialize(raw, connection.msgtype)

    return _table(path, request, messages, "a ROS bag")


def _decoder(path: Path, schema: Any) -> Any:
    """Return what decodes the ROS 2 messages of a schema."""
    typesys = library("rosbags.typesys", path, "an MCAP file of ROS messages", "ros")
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    store.register(typesys.get_types_from_msg(schema.data.decode(), schema.name))
    return lambda data: store.deserialize_cdr(data, schema.name)


def _table(path: Path, request: TableRequest, messages: Any, what: str) -> FileTable:
    values: dict[str, list[float]] = {}
    stamps: dict[str, list[int]] = {}
    try:
        for topic, logged, message in messages():
            stamp = _header_stamp(message) or logged
            for name, value in _fields(message, topic):
                values.setdefault(name, []).append(value)
                stamps.setdefault(name, []).append(stamp)
    except RecordError:
        raise
    except Exception as error:  # the readers raise many kinds on damaged files
        raise RecordError([f"{path.name}: is not readable as {what} ({error})"]) from error
    if not values:
        raise RecordError([f"{path.name}: holds no numbers in JSON or ROS messages"])

    def get(name: str) -> tuple[np.ndarray, np.ndarray, int | None]:
        when = np.array(stamps[name], dtype=np.int64)
        return np.array(values[name]), (when - when[0]) * 1e-9, int(when[0])

    return table_from_channels(path, list(values), request, get, {}, "field")


def _items(message: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(message, dict):
        yield from message.items()
    else:
        for name in getattr(message, "__dataclass_fields__", {}):
            if not name.startswith("__"):
                yield name, getattr(message, name)


def _fields(value: Any, name: str) -> Iterator[tuple[str, float]]:
    """Yield the numbers of a message with their names."""
    if isinstance(value, bool | int | float | np.number):
        yield name, float(value)
    elif isinstance(value, list | tuple | np.ndarray):
        for k, element in enumerate(value):
            if isinstance(element, int | float | np.number):
                yield f"{name}[{k}]", float(element)
    elif not isinstance(value, str | bytes):
        for part, inner in _items(value):
            yield from _fields(inner, f"{name}.{part}")


def _header_stamp(message: Any) -> int | None:
    """Return the stamp of a ROS header in ns, if it is set."""
    stamp = dict(_items(dict(_items(message)).get("header"))).get("stamp")
    parts = dict(_items(stamp))
    seconds, rest = parts.get("sec", parts.get("secs")), parts.get("nanosec", parts.get("nsecs", 0))
    return int(seconds) * 1_000_000_000 + int(rest) if seconds else None
