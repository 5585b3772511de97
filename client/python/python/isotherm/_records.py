"""Samples and increments as NumPy records, and conversions of other arrays and data frames to them."""

from __future__ import annotations

import enum
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    import pandas as pd

Records: TypeAlias = npt.NDArray[np.void]

RAW_SAMPLE: np.dtype[np.void] = np.dtype(
    [
        ("session", np.uint64),
        ("sequence", np.uint64),
        ("timestamp_ns", np.uint64),
        ("interval_ns", np.uint64),
        ("sent_ns", np.uint64),
        ("telemetry_ns", np.uint64),
        ("positive_pulses", np.uint32, (3,)),
        ("negative_pulses", np.uint32, (3,)),
        ("head_temperature", np.float64, (3,)),
        ("board_temperature", np.float64, (3,)),
    ]
)
"""A raw sample with the layout of the stream: 120 bytes."""

INCREMENT: np.dtype[np.void] = np.dtype(
    [
        ("session", np.uint64),
        ("sequence", np.uint64),
        ("timestamp_ns", np.uint64),
        ("interval_ns", np.uint64),
        ("velocity_increment", np.float64, (3,)),
        ("table", np.uint64),
        ("flags", np.uint32),
        ("latency_ns", np.uint32),
    ]
)
"""A velocity increment with the layout of the stream: 72 bytes."""

CAMPAIGN: np.dtype[np.void] = np.dtype([*RAW_SAMPLE.descr, ("set_point_c", np.float64), ("position", np.int64)])
"""A row of a campaign: a raw sample, the set point [degC], and the position's number, or -1 while the turntable moves."""

WINDOW: np.dtype[np.void] = np.dtype(
    [
        ("time_s", np.float64),
        ("seconds", np.float64),
        ("before", np.float64, (3,)),
        ("after", np.float64, (3,)),
        ("head", np.float64, (3,)),
        ("board", np.float64, (3,)),
        ("flagged", np.bool_),
        ("counts", np.bool_),
        ("still", np.bool_),
    ]
)
"""Means over one window of a verification."""

OPTIONAL = frozenset({"session", "sent_ns", "telemetry_ns"})
"""Fields that may be missing; they become 0 then."""


class Flags(enum.IntFlag):
    """Flags of a sample (bits 0 to 20) and of its delivery (bits from 24 up)."""

    A1_HEAD_BELOW = 1 << 0
    A2_HEAD_BELOW = 1 << 1
    A3_HEAD_BELOW = 1 << 2
    A1_HEAD_ABOVE = 1 << 3
    A2_HEAD_ABOVE = 1 << 4
    A3_HEAD_ABOVE = 1 << 5
    A1_BOARD_BELOW = 1 << 6
    A2_BOARD_BELOW = 1 << 7
    A3_BOARD_BELOW = 1 << 8
    A1_BOARD_ABOVE = 1 << 9
    A2_BOARD_ABOVE = 1 << 10
    A3_BOARD_ABOVE = 1 << 11
    A1_NOT_FINITE = 1 << 12
    A2_NOT_FINITE = 1 << 13
    A3_NOT_FINITE = 1 << 14
    A1_RATE = 1 << 15
    A2_RATE = 1 << 16
    A3_RATE = 1 << 17
    INTERVAL = 1 << 18
    NO_TABLE = 1 << 19
    TELEMETRY_STALE = 1 << 20
    GAP = 1 << 24
    LATE = 1 << 25


SAMPLE_FLAGS = (1 << 21) - 1
_NAMES = [(int(flag), name.lower().replace("_", "-")) for name, flag in Flags.__members__.items()]


def flag_names(flags: int) -> list[str]:
    """The names of the flags that are set, lowest bit first; empty if none is."""
    return [name for bit, name in _NAMES if flags & bit]


def is_frame(values: object) -> bool:
    """Whether `values` is a pandas data frame. Does not import pandas."""
    pandas = sys.modules.get("pandas")
    return pandas is not None and isinstance(values, pandas.DataFrame)


def _columns(frame: pd.DataFrame, dtype: np.dtype[np.void]) -> dict[str, Any]:
    """The columns of a recording by field: a list of three columns for a field with three values, else of one."""
    twice = frame.columns[frame.columns.duplicated()]
    if len(twice):
        raise ValueError(f"the column {twice[0]} is there twice")
    of = {"positive_pulses": "positive", "negative_pulses": "negative", "head_temperature": "head", "board_temperature": "board"}
    wanted = {name: [f"a{axis}_{of[name]}" for axis in (1, 2, 3)] if name in of else [name] for name in dtype.names or ()}
    missing = [column for name, columns in wanted.items() if name not in OPTIONAL for column in columns if column not in frame]
    if missing:
        raise ValueError(f"missing columns: {', '.join(missing)}; is this a recording of raw samples?")
    found = {name: columns for name, columns in wanted.items() if all(column in frame for column in columns)}
    parts: dict[str, Any] = {name: [frame[column].to_numpy() for column in columns] for name, columns in found.items()}
    if "position" in parts:
        # While the turntable moves, the field is empty in a file and missing in a data frame.
        number = frame["position"].to_numpy(dtype=np.float64, na_value=np.nan)
        parts["position"] = [np.where(np.isnan(number), -1.0, number)]
    return parts


def _exact(name: str, values: npt.NDArray[Any], dtype: np.dtype[Any]) -> npt.NDArray[Any]:
    """`values` converted to `dtype`; raises an error that names the first value that does not fit."""
    if values.dtype == dtype:
        return values
    if dtype.kind == "f":
        if values.dtype.kind not in "fiu":
            raise TypeError(f"{name} has the type {values.dtype}, give numbers")
        return values.astype(dtype)
    limits = np.iinfo(dtype)
    if values.dtype.kind not in "fiu":
        raise TypeError(f"{name} has the type {values.dtype}, give whole numbers")
    if values.dtype.kind == "f":
        # The maximum plus 1 is a power of 2, which a float represents exactly.
        right = (values >= limits.min) & (values < float(limits.max + 1)) & (values == np.floor(values))
    else:
        right = (values >= limits.min) & (values <= limits.max)
    if not right.all():
        place = tuple(np.argwhere(~right)[0])
        raise ValueError(f"{name}: row {place[0]} is {values[place]}, give a whole number from {limits.min} to {limits.max}")
    return values.astype(dtype)


def _assembled(parts: Mapping[str, Any], count: int, dtype: np.dtype[np.void]) -> Records:
    """Records assembled from fields, which are arrays or lists of columns."""
    records = np.zeros(count, dtype)
    for name, part in parts.items():
        field = records[name]
        if isinstance(part, list):
            for axis, column in enumerate(part):
                place = field if field.ndim == 1 else field[:, axis]
                place[...] = _exact(name, column, field.dtype)
        else:
            if part.shape != field.shape:
                raise TypeError(f"{name} has the shape {part.shape[1:]} in each record, give {field.shape[1:]}")
            field[...] = _exact(name, part, field.dtype)
    return records


def records(values: object, dtype: np.dtype[np.void]) -> Records:
    """`values` as contiguous records: without a copy if they are contiguous records already, else from their fields or columns."""
    if is_frame(values):
        frame: pd.DataFrame = values  # type: ignore[assignment]
        return _assembled(_columns(frame, dtype), len(frame), dtype)
    if not isinstance(values, (np.ndarray, np.void)):
        raise TypeError(f"give a structured array or a data frame, not {type(values).__name__}")
    array = np.asarray(values)
    if array.dtype == dtype:
        return np.asarray(array, order="C")
    names = array.dtype.names
    if names is None:
        raise TypeError(f"give a structured array with the fields of {dtype.names}, not one of {array.dtype}")
    missing = [name for name in dtype.names or () if name not in names and name not in OPTIONAL]
    if missing:
        raise TypeError(f"missing fields: {', '.join(missing)}")
    flat = array.reshape(-1)
    parts = {name: flat[name] for name in dtype.names or () if name in names}
    return _assembled(parts, flat.size, dtype).reshape(array.shape)


def as_bytes(array: Records) -> npt.NDArray[np.uint8]:
    """The bytes of contiguous records, without a copy."""
    return array.reshape(-1).view(np.uint8)


def sample_bytes(samples: object) -> npt.NDArray[np.uint8]:
    """Raw samples as bytes."""
    return as_bytes(records(samples, RAW_SAMPLE))


def one_sample(sample: object) -> bytes:
    """The bytes of one raw sample."""
    if isinstance(sample, (np.void, np.ndarray)) and sample.dtype == RAW_SAMPLE and sample.size == 1:
        return sample.tobytes()
    array = records(sample, RAW_SAMPLE)
    if array.size != 1:
        raise ValueError(f"give one sample, not {array.size}")
    return array.tobytes()


def flat_doubles(values: object) -> npt.NDArray[np.float64]:
    """An array of any shape as a contiguous one-dimensional array of doubles."""
    return np.ascontiguousarray(values, dtype=np.float64).reshape(-1)


def increments_frame(increments: Records, index: pd.Index[Any]) -> pd.DataFrame:
    """Increments as a data frame with the columns of a recording."""
    import pandas as pd

    dv = increments["velocity_increment"]
    data: dict[str, Any] = {name: increments[name] for name in ("sequence", "timestamp_ns", "interval_ns")}
    data |= {f"a{axis + 1}_dv": dv[:, axis] for axis in range(3)}
    tables, table = np.unique(increments["table"], return_inverse=True)
    flags, flag = np.unique(increments["flags"] & np.uint32(SAMPLE_FLAGS), return_inverse=True)
    names = [f"{value:016x}" for value in tables.tolist()]
    data["table"] = pd.Categorical.from_codes(table, dtype=pd.CategoricalDtype(names))
    names = ["|".join(flag_names(value)) or "-" for value in flags.tolist()]
    data["flags"] = pd.Categorical.from_codes(flag, dtype=pd.CategoricalDtype(names))
    return pd.DataFrame(data, index=index)
