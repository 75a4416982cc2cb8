"""The channels of a TDMS file (LabVIEW), each at its own rate."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from estimation.files.faults import RecordError
from estimation.files.optional_library import library
from estimation.files.own_times import table_from_channels
from estimation.files.table import FileTable, TableRequest

__all__ = ["read_tdms"]


def read_tdms(path: Path, request: TableRequest) -> FileTable:
    """Read channels of a TDMS file; see `estimation.files.read_table.read_table`.

    A channel is called ``group/channel``, or by its own name where that is the only one.  Its time is that of its
    waveform properties; channels without them take the time channel of their group.
    """
    nptdms = library("nptdms", path, "a TDMS file", "tdms")
    try:
        file = nptdms.TdmsFile.read(path)
    except Exception as error:  # the reader raises many kinds on damaged files
        raise RecordError([f"{path.name}: is not a readable TDMS file ({error}): export it again"]) from error
    every = [channel for group in file.groups() for channel in group.channels()]
    if not every:
        raise RecordError([f"{path.name}: is not a readable TDMS file (it holds no channels): export it again"])
    short = [channel.name for channel in every]
    by_name = {c.name if short.count(c.name) == 1 else f"{c.group_name}/{c.name}": c for c in every}
    units = {name: str(c.properties.get("unit_string", "") or "") for name, c in by_name.items()}
    known = {**{f"{c.group_name}/{c.name}": c for c in every}, **by_name}

    def get(name: str) -> tuple[np.ndarray, np.ndarray, int | None]:
        channel = known[name]
        if "wf_increment" in channel.properties:
            began = channel.properties.get("wf_start_time")
            origin = None if began is None else int(np.datetime64(began, "ns").astype(np.int64))
            return np.asarray(channel[:]), np.asarray(channel.time_track()), origin
        return np.asarray(channel[:]), *_time_channel(path, name, channel, file, request.time)

    names = list(by_name)
    asked = [n for n in request.every if n in known and n not in by_name]
    return table_from_channels(path, [*names, *asked], request, get, units, "channel")


def _time_channel(path: Path, name: str, channel: object, file: object, time: str) -> tuple[np.ndarray, int | None]:
    """Return the time channel of a channel's group, and its calendar time."""
    group = {c.name: c for c in file[channel.group_name].channels()}  # type: ignore[index, attr-defined]
    if time in group:
        stamps = np.asarray(group[time][:])
        if stamps.dtype.kind == "M":
            fine = stamps.astype("datetime64[ns]").astype(np.int64)
            return (fine - fine[0]) * 1e-9, int(fine[0])
        return np.asarray(stamps, dtype=float), None
    raise RecordError(
        [
            f"{path.name}: the channel '{name}' has no waveform properties, and its group has no time channel"
            + (f" '{time}'" if time else "")
            + f': name one of {", ".join(group)} with time = "…" in [records]'
        ]
    )
