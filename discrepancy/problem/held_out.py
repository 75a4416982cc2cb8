"""Whether records that are held out are indeed others than those that are fitted: by what was measured, not by name."""

from __future__ import annotations

from collections.abc import Sequence

from estimation.files.record import Record
from estimation.files.shared_rows import near_copies, shared_rows

__all__ = ["held_out_content"]


def held_out_content(
    identify: Sequence[Record], validate: Sequence[Record], outputs: Sequence[str]
) -> tuple[list[str], list[str]]:
    """Return the faults and the warnings of records that hold the same measurement.

    Parameters
    ----------
    identify, validate : sequence of Record
    outputs : sequence of str
        Measured outputs, which no two trips have alike; the inputs they may.

    Returns
    -------
    faults, warnings : list of str
    """
    records = (*identify, *validate)
    count = len(identify)
    files = [r.path.name if r.path.stem.startswith(r.name) else f"{r.path.name} ({r.name})" for r in records]
    faults = []
    for same in shared_rows(records, outputs):
        first, second = files[same.first], files[same.second]
        whole = same.rows >= 0.99 * len(records[same.second].time)
        extent = "is a copy of" if whole else f"from {same.start:.6g} to {same.stop:.6g} s holds rows of"
        if same.first < count <= same.second:
            faults.append(
                f"[records] validate: '{second}' {extent} '{first}', which is in identify ({same.rows} rows of outputs "
                "are the same): what is held out must not be used for fitting; record again, or take it out of one of "
                "the lists"
            )
        else:
            key = "identify" if same.second < count else "validate"
            faults.append(
                f"[records] {key}: '{second}' {extent} '{first}' ({same.rows} rows of outputs are the same) and would "
                "count twice: name one of the two"
            )
    across = [(i, j) for j in range(count, len(records)) for i in range(count)]
    near = near_copies(records, outputs, across) if not faults else []
    if near is None:
        return faults, ["[records] validate: too many samples to search for copies that were rounded or scaled anew"]
    warnings = [
        f"[records] validate: '{files[j]}' has the noise of '{files[i]}', which is in identify: it looks like the same "
        "measurement, rounded or scaled anew, and then confirms nothing"
        for i, j in near
    ]
    return faults, warnings
