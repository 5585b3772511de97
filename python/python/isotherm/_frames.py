"""Arrays of records as data frames of pandas and tables of Arrow, and back."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ._columns import Columns, columns_of, is_frame, needed
from ._records import CAMPAIGN, INCREMENT, RAW_SAMPLE, Records, at, column_names, flag_names, paths, records, rows_of

if TYPE_CHECKING:
    from datetime import datetime

    import pandas as pd
    import pyarrow as _pa  # type: ignore[import-untyped]

DELIVERY = np.uint64(0b1111 << 24)
"""The flags of the delivery of an increment, which recordings have in a column of their own."""
_FIRST = ("set_point_c", "position", "session", "sequence", "timestamp_ns", "interval_ns", "sent_ns", "telemetry_ns")
_ENDS = ("positive", "negative", "head", "board", "dv", "da")
_OTHERS = {"device": 3, "lag_ns": 5, "table": 7, "flags": 8, "delivery": 9, "flag_bits": 10, "latency_ns": 11}


def to_frame(array: Records, *, epoch: datetime | np.datetime64 | str | None = None) -> pd.DataFrame:
    """Records of RAW_SAMPLE, CAMPAIGN or INCREMENT as a data frame of pandas, with the columns of a recording and an index by time.

    The index is a TimedeltaIndex, "time", of `timestamp_ns`: the clock of the acquisition is monotonic, and 0 is no date. Where you know the date of
    its 0, give it as `epoch`, "1970-01-01" for times since 1970: then it is a DatetimeIndex. `timestamp_ns` stays a column, so that nothing is lost,
    and all functions take the frame.

    All columns are always there, so that frames can be joined: `session` and all others as numbers of the array's types, `device` and `table` as texts of 16
    hexadecimal digits, `flags` and `delivery` as names joined by |, and as one number in `flag_bits`, which counts for the way back. `from_frame` gives the same array, bit for bit.

    Raises ImportError without pandas, and ValueError for times that an index cannot have, from 2^63 ns on; `to_arrow` has no index.

    >>> samples = isotherm.read_recording("run.csv")
    >>> frame = isotherm.to_frame(samples)
    >>> len(frame) == len(samples), frame.index.name
    (True, 'time')
    """
    try:
        import pandas as pd
    except ImportError:
        raise needed("pandas", "to_frame", "pandas") from None
    rows = _rows(array)
    times = rows["timestamp_ns"]
    beyond = times > np.uint64(np.iinfo(np.int64).max)
    if beyond.any():
        row = int(np.argmax(beyond))
        raise ValueError(f"timestamp_ns: row {row} is {times[row]}, but an index holds less than 2^63 ns; use to_arrow, which has no index")
    index: pd.Index[Any] = pd.TimedeltaIndex(times.astype("timedelta64[ns]"), name="time")
    if epoch is not None:
        try:
            index = (pd.Timestamp(epoch).as_unit("ns") + index).rename("time")  # type: ignore[operator]
        except OverflowError:
            raise ValueError(f"epoch is {epoch}; with timestamp_ns up to {times.max()} that is no date in 64 bits of nanoseconds") from None
    data: dict[str, Any] = {}
    for name, values, names in _columns_of(rows):
        data[name] = values if names is None else pd.Categorical.from_codes(values, dtype=pd.CategoricalDtype(names))
    return pd.DataFrame(data, index=index)


def from_frame(frame: pd.DataFrame, dtype: np.dtype[np.void] | None = None) -> Records:
    """The records of a data frame that has the columns of a recording, as `to_frame` or pandas.read_csv gives them. The index does not matter.

    They are INCREMENT if there are increments, CAMPAIGN if there are set points, and otherwise RAW_SAMPLE, unless `dtype` is given. Columns that are optional in
    recordings may be missing. Raises ValueError or TypeError, with the column and the row, counted from 0, where a value does not fit.

    >>> samples = isotherm.read_recording("run.csv")
    >>> isotherm.from_frame(isotherm.to_frame(samples)).tobytes() == samples.tobytes()
    True
    """
    if not is_frame(frame):
        raise TypeError(f"give a data frame of pandas, not {type(frame).__name__}; from_arrow takes tables of Arrow and polars")
    return _records(frame, dtype)


def to_arrow(array: Records) -> _pa.Table:
    """Records of RAW_SAMPLE, CAMPAIGN or INCREMENT as a table of Arrow, with the columns of `to_frame`. It has no index; `timestamp_ns` has the time.

    polars, DuckDB and others take it: `polars.from_arrow(isotherm.to_arrow(array))`. `from_arrow` gives the same array, bit for bit. Raises
    ImportError without pyarrow.

    >>> samples = isotherm.read_recording("run.csv")
    >>> isotherm.to_arrow(samples).num_rows == len(samples)
    True
    """
    try:
        import pyarrow as pa
    except ImportError:
        raise needed("pyarrow", "to_arrow", "arrow") from None
    columns: dict[str, Any] = {}
    for name, values, names in _columns_of(_rows(array)):
        plain = pa.array(np.ascontiguousarray(values))
        columns[name] = plain if names is None else pa.DictionaryArray.from_arrays(plain, pa.array(names, pa.string()))
    return pa.table(columns)


def from_arrow(table: Any, dtype: np.dtype[np.void] | None = None) -> Records:
    """The records of a table of Arrow, or of any object that has the Arrow stream of a table (`__arrow_c_stream__`), such as a data frame of polars.

    Columns and `dtype` are as those of `from_frame`. Raises ImportError without pyarrow.

    >>> samples = isotherm.read_recording("run.csv")
    >>> isotherm.from_arrow(isotherm.to_arrow(samples)).tobytes() == samples.tobytes()
    True
    """
    if not hasattr(table, "__arrow_c_stream__"):
        raise TypeError(f"give a table of Arrow, or an object with __arrow_c_stream__, not {type(table).__name__}")
    return _records(table, dtype)


def _records(table: Any, dtype: np.dtype[np.void] | None) -> Records:
    columns = columns_of(table)
    assert columns is not None
    known = (RAW_SAMPLE, CAMPAIGN, INCREMENT)
    if dtype is not None and dtype not in known:
        raise ValueError(f"dtype is {dtype}, give RAW_SAMPLE, CAMPAIGN or INCREMENT")
    return records(table, _kind(columns) if dtype is None else dtype)


def _kind(columns: Columns) -> np.dtype[np.void]:
    if "a1_dv" in columns.names:
        return INCREMENT
    return CAMPAIGN if "set_point_c" in columns.names else RAW_SAMPLE


def _rows(array: Any) -> Records:
    kind = getattr(array, "dtype", None)
    names = getattr(kind, "names", None) or ()
    if not isinstance(array, (np.ndarray, np.void)) or not names:
        raise TypeError(f"give an array of RAW_SAMPLE, CAMPAIGN or INCREMENT, not {kind if kind is not None else type(array).__name__}")
    if "velocity_increment" in names:
        return rows_of(array, INCREMENT)
    return rows_of(array, CAMPAIGN if "set_point_c" in names else RAW_SAMPLE)


def _columns_of(rows: Records) -> Iterator[tuple[str, npt.NDArray[Any], list[str] | None]]:
    """Name and values of each column in the order of a recording; of a column of texts the different ones, and the values are their indices."""
    columns: dict[str, npt.NDArray[Any]] = {}
    for path in paths(rows.dtype):
        values = at(rows, path)
        columns |= dict(zip(column_names(path), values.T if values.ndim == 2 else [values], strict=True))
    if "flags" in columns:
        columns["delivery"] = columns["flags"] & DELIVERY
        columns["flag_bits"] = columns["flags"]
        columns["flags"] = columns["flags"] & ~DELIVERY
    for name in sorted(columns, key=_place):
        if name in ("device", "table"):
            yield name, *_texts(columns[name], lambda number: f"{number:016x}")
        elif name in ("flags", "delivery"):
            yield name, *_texts(columns[name], lambda bits: "|".join(flag_names(bits)) or "-")
        else:
            yield name, columns[name], None


def _texts(numbers: npt.NDArray[np.uint64], text: Callable[[int], str]) -> tuple[npt.NDArray[np.int32], list[str]]:
    different, index = np.unique(numbers, return_inverse=True)
    texts = [text(number) for number in different.tolist()]
    # Flags without a name have no text of their own.
    names = list(dict.fromkeys(texts))
    place = np.array([names.index(each) for each in texts], np.int32)
    return (place[index] if len(place) else index.astype(np.int32)), names


def _place(name: str) -> tuple[int, str]:
    """The place of a column: those of a sensor stand together, with those of the lag behind them."""
    if name.endswith("_head_lagged"):
        return 6, name
    if name[:1] in "ag" and name[1:2].isdigit():
        sensor, _, end = name.partition("_")
        return 2 if sensor[0] == "a" else 4, f"{sensor}{_ENDS.index(end)}"
    return (0, str(_FIRST.index(name))) if name in _FIRST else (_OTHERS[name], "")
