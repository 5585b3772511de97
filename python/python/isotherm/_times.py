"""Times of datetime, NumPy and pandas as nanoseconds. Imports pandas by no means: its types are subtypes of those of datetime."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

# Seconds since the begin of a recording, or a time stamp as the command takes it; or both as a time of datetime,
# NumPy or pandas.
Moment: TypeAlias = float | str | datetime | timedelta | np.datetime64 | np.timedelta64

_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
_MICROSECOND = timedelta(microseconds=1)
_TIMES = (datetime, timedelta, np.datetime64, np.timedelta64)
_LIMITS = np.iinfo(np.int64)


def is_time(value: object) -> bool:
    return isinstance(value, _TIMES)


def ns_of(time: Any) -> int:
    """Nanoseconds of a duration, or since 1970 of a time, in UTC; one without a time zone is taken to be in UTC. Raises ValueError for NaT."""
    if time != time:
        raise ValueError("NaT is no time")
    if isinstance(time, (np.datetime64, np.timedelta64)):
        kind = "datetime64" if isinstance(time, np.datetime64) else "timedelta64"
        ns = time.astype(f"{kind}[ns]")
        if ns.astype(time.dtype) != time:
            raise ValueError(f"{time!r} is beyond 64 bits of nanoseconds")
        return int(ns.astype(np.int64))
    if isinstance(time, datetime):
        aware = time if time.tzinfo else time.replace(tzinfo=timezone.utc)
        # Without the nanoseconds of pandas, whose differences may not have them.
        plain = datetime.combine(aware.date(), aware.timetz())
        return (plain - _EPOCH) // _MICROSECOND * 1000 + int(getattr(time, "nanosecond", 0))
    plain_delta = timedelta(time.days, time.seconds, time.microseconds)
    return plain_delta // _MICROSECOND * 1000 + int(getattr(time, "nanoseconds", 0))


def moment_text(moment: Moment | None) -> str | None:
    """A moment as the command takes it."""
    if moment is None or isinstance(moment, str):
        return moment
    if isinstance(moment, (datetime, np.datetime64)):
        return f"{ns_of(moment)}ns"
    if isinstance(moment, (timedelta, np.timedelta64)):
        return repr(ns_of(moment) / 1e9)
    return repr(float(moment))


def whole_ns(name: str, values: Any) -> npt.NDArray[np.int64] | None:
    """A column of times as nanoseconds; None if it is none of times.

    A column of times with a time zone is in UTC then, and one without is taken to be in UTC.
    """
    kind = str(getattr(values, "dtype", ""))
    if kind.startswith(("datetime64", "timestamp", "timedelta64", "duration")):
        is_stamp = kind.startswith(("datetime64", "timestamp"))
        array = values
        if not isinstance(values, np.ndarray):
            # Of pandas: in UTC.
            array = values.to_numpy(dtype="datetime64[ns]" if is_stamp else "timedelta64[ns]")
        missing = np.isnat(array)
        if missing.any():
            raise ValueError(f"{name}: row {int(np.argmax(missing))} is NaT, give a time")
        whole = array.astype("datetime64[ns]" if is_stamp else "timedelta64[ns]")
        wrong = whole.astype(array.dtype) != array
        if wrong.any():
            row = int(np.argmax(wrong))
            raise ValueError(f"{name}: row {row} is {array[row]}, which 64 bits of nanoseconds do not hold")
        return whole.astype(np.int64)  # type: ignore[no-any-return]
    array = np.asarray(values)
    if array.dtype != object or not any(map(is_time, array[:1].tolist() + array[-1:].tolist())):
        return None
    return _checked(name, array.tolist())


def _checked(name: str, times: list[Any]) -> npt.NDArray[np.int64]:
    whole = np.empty(len(times), np.int64)
    for row, time in enumerate(times):
        try:
            ns = time if isinstance(time, int) else ns_of(time)
        except (ValueError, AttributeError, TypeError):
            raise ValueError(f"{name}: row {row} is {time!r}, give a time") from None
        if not _LIMITS.min < ns <= _LIMITS.max:
            raise ValueError(f"{name}: row {row} is {time!r}, which 64 bits of nanoseconds do not hold")
        whole[row] = ns
    return whole
