"""Calendar times: text as dates, and numbers that count seconds since 1970, both as seconds since the first."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimation.files.faults import Rows

__all__ = ["CALENDAR_FROM", "calendar_text", "dates_from_text", "format_fault", "seconds_since_first", "zone_fault"]

#: Seconds since 1970 from which a number is taken for a calendar time (1973).  A recording of three years that
#: began at zero would be taken for one too; numbers of this size leave a double no room for steps below 1e-8 s.
CALENDAR_FROM = 1e8
_ZONED = re.compile(r"(Z|[+-]\d{2}:?\d{2})$")


_TIME_OF_DAY = r"\d{1,3}:\d{2}(:\d{2}(\.\d+)?)?"


@dataclass(frozen=True)
class Dates:
    """Times of a column that states dates.

    Attributes
    ----------
    seconds : ndarray, shape (n,), s
        Since the first; NaN where a cell is empty.
    origin : int or None
        Of the first: ns since 1970, UTC; None for times of day without a date.
    log : tuple of str
        What was assumed.
    """

    seconds: np.ndarray
    origin: int | None
    log: tuple[str, ...]


def calendar_text(origin: int) -> str:
    """Return a calendar time as text.

    Examples
    --------
    >>> calendar_text(1709287200_500000000)
    '2024-03-01 10:00:00.500 UTC'
    """
    text = str(np.datetime64(origin, "ns").astype("datetime64[ms]"))
    return text.replace("T", " ") + " UTC"


def seconds_since_first(column: str, stamps: np.ndarray) -> Dates:
    """Return an array of dates (``datetime64``) as seconds since the first.

    Parameters
    ----------
    column : str
        Its name, for the log.
    stamps : ndarray of datetime64, shape (n,)
    """
    fine = stamps.astype("datetime64[ns]")
    missing = np.isnat(fine)
    count = fine.astype(np.int64)
    origin = int(count[~missing][0]) if not missing.all() else 0
    seconds = (count - origin) * 1e-9
    seconds[missing] = np.nan
    log = (f"{column}: dates, read as seconds since the first", f"{column}: time 0 is {calendar_text(origin)}")
    return Dates(seconds, origin, log)


def dates_from_text(
    name: str, column: str, cells: Sequence[str], rows: Rows, form: str | None, zone: str | None
) -> tuple[Dates, list[str]]:
    """Read dates or times of day from text.

    Parameters
    ----------
    name, column : str
        File and column, for messages.
    cells : sequence of str, length n
    rows : Rows
    form : str, optional
        How the dates are written, such as ``"%d/%m/%Y %H:%M:%S"``; needed where days and months can be confused.
    zone : str, optional
        Time zone of dates that state none, such as ``"Europe/Berlin"``; default UTC.

    Returns
    -------
    Dates
    list of str
        Faults.
    """
    import pandas as pd

    text = pd.Series(cells, dtype=str).str.strip().str.replace(",", ".", regex=False)
    empty = text.str.lower().isin(["", "nan", "na", "n/a", "nat", "null", "none"])
    known = text[~empty]
    sample = str(known.iloc[0]) if len(known) else ""
    nothing = Dates(np.full(len(text), np.nan), None, ())
    where = f"{name}, column '{column}'"
    if re.fullmatch(_TIME_OF_DAY, sample) and form is None:
        whole = text.where(text.str.count(":") == 2, text + ":00")
        passed = pd.to_timedelta(whole.where(~empty), errors="coerce")
        of_day = text.str.fullmatch(_TIME_OF_DAY).to_numpy(dtype=bool)  # numbers beside one time of day are no times
        wrong = (passed.isna().to_numpy() | ~of_day) & ~empty.to_numpy()
        seconds = passed.dt.total_seconds().to_numpy(dtype=float)
        seconds = _past_midnight(seconds)
        first = seconds[np.isfinite(seconds)][0] if np.isfinite(seconds).any() else 0.0
        day = f"{column}: times of day, read as seconds since the first, {sample}"
        return Dates(seconds - first, None, (day,)), _faults(where, text, rows, wrong)
    # commas of the text are dots by now
    written: dict[str, Any] = {"format": form and form.replace(",", ".")}
    if form is None:
        order, remedy = _order(known, sample)
        if remedy:
            return nothing, [f"{where}: {remedy}"]
        written = order
    zoned = bool(_ZONED.search(sample)) and not re.fullmatch(r"\d{4}-\d{2}-\d{2}", sample)
    stamps = pd.to_datetime(text.where(~empty), errors="coerce", utc=zoned, **written)
    wrong = stamps.isna().to_numpy() & ~empty.to_numpy()
    if wrong.any():
        return nothing, _faults(where, text, rows, wrong)
    log = []
    if not zoned:
        try:
            stamps = stamps.dt.tz_localize(zone or "UTC", ambiguous="infer", nonexistent="raise")
        except Exception as error:  # unknown zones and clock changes raise different kinds
            return nothing, [
                f"{where}: cannot be read in the time zone '{zone}' ({error}): name one such as 'Europe/Berlin', or "
                "record in UTC"
            ]
        log = [f"{column}: no time zone stated, taken as {zone or 'UTC'}"]
    dates = seconds_since_first(column, stamps.dt.tz_convert("UTC").dt.tz_localize(None).to_numpy())
    return Dates(dates.seconds, dates.origin, (*dates.log, *log)), []


def format_fault(form: str) -> str:
    """Return what is wrong with how dates are said to be written, or an empty text.

    Examples
    --------
    >>> format_fault("%d/%m/%Y %H:%M:%S"), format_fault("ISO8601")
    ('', '')
    >>> format_fault("dd/mm/yyyy")
    "'dd/mm/yyyy' must name the parts of a date, such as %d/%m/%Y %H:%M:%S"
    """
    import pandas as pd

    if form in ("ISO8601", "mixed"):  # names that pandas has for forms
        return ""
    try:
        pd.to_datetime([pd.Timestamp("2001-02-03 04:05:06").strftime(form)], format=form)
        sound = bool(re.search("%[A-Za-z]", form))
    except ValueError:
        sound = False
    return "" if sound else f"'{form}' must name the parts of a date, such as %d/%m/%Y %H:%M:%S"


def zone_fault(zone: str) -> str:
    """Return what is wrong with the name of a time zone, or an empty text.

    Examples
    --------
    >>> zone_fault("Europe/Berlin"), zone_fault("UTC"), zone_fault("+01:00")
    ('', '', '')
    >>> zone_fault("Europe/Berlim")
    "there is no time zone 'Europe/Berlim': name one such as 'Europe/Berlin' or 'UTC'"
    """
    import pandas as pd

    try:
        pd.Timestamp("2001-01-01").tz_localize(zone)
    except Exception:  # unknown zones raise different kinds
        return f"there is no time zone '{zone}': name one such as 'Europe/Berlin' or 'UTC'"
    return ""


def _past_midnight(seconds: np.ndarray) -> np.ndarray:
    """Add a day after each step back of more than half a day."""
    steps = np.diff(seconds, prepend=seconds[:1])
    days: np.ndarray = seconds + 86400.0 * np.cumsum(np.nan_to_num(steps) < -43200.0)
    return days


def _order(known: Any, sample: str) -> tuple[dict[str, Any], str]:
    """Return how pandas is to read dates like these, and a remedy where that is not clear."""
    if re.match(r"\d{4}[-/.]", sample):
        return ({"format": "ISO8601"} if sample[4] == "-" else {"format": "mixed", "yearfirst": True}), ""
    if re.match(r"\d{1,2}\.\d{1,2}\.\d{4}", sample):
        return {"format": "mixed", "dayfirst": True}, ""
    parts = known.str.extract(r"^(\d{1,2})[-/](\d{1,2})[-/]\d{2,4}").astype(float).max()
    if parts.isna().any():
        return {}, f"'{sample}' is not understood as a date: say how it is written with time_format in [records]"
    if parts[0] > 12 or parts[1] > 12:
        return {"format": "mixed", "dayfirst": bool(parts[0] > 12)}, ""
    return {}, (
        f"'{sample}' may be day/month or month/day: say which with time_format = \"%d/%m/%Y %H:%M:%S\" or "
        '"%m/%d/%Y %H:%M:%S" in [records]'
    )


def _faults(where: str, text: Any, rows: Rows, wrong: np.ndarray) -> list[str]:
    if not wrong.any():
        return []
    sample = str(text.iloc[int(np.flatnonzero(wrong)[0])])
    return [f"{where}, {rows.say(wrong)}: '{sample}' is not a date written as the others: repair these rows"]
