"""How much memory a recording may take: a small file that unpacks to gigabytes is refused before it is unpacked."""

from __future__ import annotations

import zlib
from pathlib import Path

from estimation.files.faults import RecordError
from multibody.base.memory_of_process import machine_memory

__all__ = ["check_size", "unpacked_gzip"]

#: Share of the machine's memory that the numbers of one file may take; text takes about eight times its own size
#: while it is read.
SHARE = 0.25
TEXT_FACTOR = 8.0
#: How many times its packed size a file may unpack to.  Measurements as text pack to a third or a tenth, a constant
#: channel to a hundredth; deflate cannot exceed 1032.
MOST_RATIO = 200.0
#: Below this many bytes the ratio does not matter.
HARMLESS = 64 << 20
_CHUNK = 1 << 20


def check_size(name: str, size: float, packed: float, *, text: bool = False) -> None:
    """Refuse a file whose content would not fit in memory, or is out of all proportion to the file.

    Parameters
    ----------
    name : str
        Of the file.
    size, packed : float, bytes
        Of what is to be read, and of the file.
    text : bool
        Whether it is text, which takes more while it is read.

    Raises
    ------
    RecordError
        With both sizes and the remedy.
    """
    if size > HARMLESS and size > MOST_RATIO * packed:
        raise RecordError(
            [
                f"{name}: unpacks from {packed / 1e6:.3g} MB to more than {size / 1e6:.3g} MB, as no recording does: "
                "it is damaged or made to fill the memory; if it is sound, unpack it and name the unpacked file"
            ]
        )
    needed, have = size * (TEXT_FACTOR if text else 1.0), SHARE * machine_memory()
    if needed > have:
        raise RecordError(
            [
                f"{name}: holds {size / 1e9:.3g} GB{' of text' if text else ''} and would take {needed / 1e9:.3g} GB "
                f"of memory, more than the {have / 1e9:.3g} GB that one recording may have here: cut it into shorter "
                "recordings, lower its rate, or keep fewer columns"
            ]
        )


def unpacked_gzip(path: Path, raw: bytes) -> bytes:
    """Return the content of a gzip file, member by member and never more than is allowed.

    Raises
    ------
    RecordError
        If it is damaged, or its content is too large.
    """
    parts: list[bytes] = []
    size, rest = 0, raw
    try:
        while rest:
            stream = zlib.decompressobj(wbits=31)
            while not stream.eof:
                part = stream.decompress(rest, _CHUNK)
                if not part and not stream.eof and not stream.unconsumed_tail:
                    raise EOFError("it ends before its end marker")
                rest = stream.unconsumed_tail
                size += len(part)
                check_size(path.name, size, len(raw), text=True)
                parts.append(part)
            rest = stream.unused_data.lstrip(b"\0")  # as gzip does: padding between members
    except (EOFError, zlib.error) as error:
        raise RecordError(
            [f"{path.name}: the compressed file is damaged or cut off ({error}): copy it again"]
        ) from error
    return b"".join(parts)
