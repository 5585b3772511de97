"""Samples and increments as NumPy records, and conversions of other arrays and data frames to them."""

from __future__ import annotations

import enum
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from ._columns import Columns, columns_of, is_frame

if TYPE_CHECKING:
    import pandas as pd

Records: TypeAlias = npt.NDArray[np.void]

TRIAD: np.dtype[np.void] = np.dtype(
    [
        ("positive_pulses", np.uint32, (3,)),
        ("negative_pulses", np.uint32, (3,)),
        ("head_temperature", np.float64, (3,)),
        ("board_temperature", np.float64, (3,)),
        ("head_lagged", np.float64, (3,)),
    ]
)
"""What three sensors of one kind have measured: 96 bytes."""

RAW_SAMPLE: np.dtype[np.void] = np.dtype(
    [
        ("session", np.uint64),
        ("sequence", np.uint64),
        ("timestamp_ns", np.uint64),
        ("interval_ns", np.uint64),
        ("sent_ns", np.uint64),
        ("telemetry_ns", np.uint64),
        ("lag_ns", np.uint64),
        ("device", np.uint64),
        ("accelerometers", TRIAD),
        ("gyroscopes", TRIAD),
    ]
)
"""A raw sample with the layout of the stream: 256 bytes."""

INCREMENT: np.dtype[np.void] = np.dtype(
    [
        ("session", np.uint64),
        ("sequence", np.uint64),
        ("timestamp_ns", np.uint64),
        ("interval_ns", np.uint64),
        ("velocity_increment", np.float64, (3,)),
        ("angle_increment", np.float64, (3,)),
        ("table", np.uint64),
        ("flags", np.uint64),
        ("latency_ns", np.uint64),
    ]
)
"""An increment with the layout of the stream: 104 bytes."""

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

OPTIONAL = frozenset({"session", "sent_ns", "telemetry_ns", "lag_ns", "device", "gyroscopes", "head_lagged"})
"""Fields that may be missing; they become 0 then, and the temperature of missing gyroscopes NaN."""

Path: TypeAlias = tuple[str, ...]
"""Where a value is in a record: the name of a field, or of a triad and its field."""


def paths(dtype: np.dtype[np.void]) -> list[Path]:
    """The paths of all values of a record, in the order of its bytes."""
    inner = {name: dtype[name] for name in dtype.names or ()}
    return [path for name, field in inner.items() for path in ([(name, part) for part in field.names] if field.names else [(name,)])]


def at(array: Any, path: Path) -> Any:
    for name in path:
        array = array[name]
    return array


class Flags(enum.IntFlag):
    """Flags of a sample (bits 0 to 23 and 50, and of the gyroscopes 32 to 49) and of its delivery (24 to 27), and masks.

    They can be combined with integers and with arrays: `increments["flags"] & Flags.LOST`.

    INVALID: an increment could not be computed and is NaN, on one axis or on all.
    DEGRADED: computed, outside of what the calibration covers or without a part of it; NaN under the policy `reject`.
    LOST: time is missing before this increment, or may be.
    INFORMATION: says nothing against the increment.
    Together they have every flag, each once. Use a value if it is finite.

    >>> flags = np.array([0, isotherm.Flags.GAP], np.uint64)
    >>> (flags & isotherm.Flags.LOST) != 0
    array([False,  True])
    """

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
    LAG_UNKNOWN = 1 << 21
    OTHER_DEVICE = 1 << 22
    G_UNKNOWN = 1 << 23
    GAP = 1 << 24
    LATE = 1 << 25
    TIME_STEP = 1 << 26
    SESSION = 1 << 27
    G1_HEAD_BELOW = 1 << 32
    G2_HEAD_BELOW = 1 << 33
    G3_HEAD_BELOW = 1 << 34
    G1_HEAD_ABOVE = 1 << 35
    G2_HEAD_ABOVE = 1 << 36
    G3_HEAD_ABOVE = 1 << 37
    G1_BOARD_BELOW = 1 << 38
    G2_BOARD_BELOW = 1 << 39
    G3_BOARD_BELOW = 1 << 40
    G1_BOARD_ABOVE = 1 << 41
    G2_BOARD_ABOVE = 1 << 42
    G3_BOARD_ABOVE = 1 << 43
    G1_NOT_FINITE = 1 << 44
    G2_NOT_FINITE = 1 << 45
    G3_NOT_FINITE = 1 << 46
    G1_RATE = 1 << 47
    G2_RATE = 1 << 48
    G3_RATE = 1 << 49
    INTERVAL_NOT_NOMINAL = 1 << 50

    INVALID = INTERVAL | NO_TABLE | (0b111 << 12) | (0b111 << 44)
    DEGRADED = 0xFFF | (0b111 << 15) | (0xFFF << 32) | (0b111 << 47) | TELEMETRY_STALE | LAG_UNKNOWN | OTHER_DEVICE | G_UNKNOWN | INTERVAL_NOT_NOMINAL
    LOST = GAP | TIME_STEP | SESSION
    INFORMATION = LATE

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        """NumPy would take a member for a signed integer, which has no type in common with the unsigned ones of an array."""
        # NumPy 1.26 takes a plain integer next to an unsigned scalar for a signed one, too.
        unsigned = any(getattr(value, "dtype", None) == np.uint64 for value in inputs)
        kind = np.uint64 if unsigned else int
        plain = [kind(int(value)) if isinstance(value, Flags) else value for value in inputs]
        return getattr(ufunc, method)(*plain, **options)


SAMPLE_FLAGS = (1 << 24) - 1 | (1 << 19) - 1 << 32
_NAMES = [(int(flag), name.lower().replace("_", "-")) for name, flag in Flags.__members__.items() if int(flag).bit_count() == 1 and name != "INFORMATION"]


def flag_names(flags: int) -> list[str]:
    """The names of the flags that are set, lowest bit first; empty if none is.

    >>> isotherm.flag_names(isotherm.Flags.GAP | isotherm.Flags.LATE)
    ['gap', 'late']
    """
    return [name for bit, name in _NAMES if flags & bit]


PARTS = {"positive_pulses": "positive", "negative_pulses": "negative", "head_temperature": "head", "board_temperature": "board"}
"""The ends of a triad's columns in a recording, without those of the lagged temperature."""


OF_FRAMES = OPTIONAL | {"latency_ns", "angle_increment"}
"""Fields whose columns may be missing; angle increments become NaN then."""
AXES = {"velocity_increment": "a{}_dv", "angle_increment": "g{}_da"}
"""The columns of the increments of three axes."""


def column_names(path: Path) -> list[str]:
    """The columns of a value: three for a value of three sensors, else one."""
    if len(path) == 2:
        return [f"{path[0][0]}{axis}_{PARTS.get(path[1], path[1])}" for axis in (1, 2, 3)]
    return [AXES[path[0]].format(axis) for axis in (1, 2, 3)] if path[0] in AXES else [path[0]]


def _wanted(names: set[str], dtype: np.dtype[np.void]) -> dict[Path, list[str]]:
    """The columns of each value that a frame must have. What is optional is wanted if one of its columns is there."""
    gyroscopes = any(f"g{axis}_{end}" in names for axis in (1, 2, 3) for end in PARTS.values())
    lag = "lag_ns" in names or any(f"{letter}{axis}_head_lagged" in names for letter in "ag" for axis in (1, 2, 3))
    wanted: dict[Path, list[str]] = {}
    for path in paths(dtype):
        columns = column_names(path)
        if len(path) == 2:
            if (path[0][0] == "a" or gyroscopes) and (path[1] in PARTS or lag):
                wanted[path] = columns
        elif path == ("flags",) and "flag_bits" in names:
            wanted[path] = ["flag_bits"]
        elif path[0] not in OF_FRAMES or not names.isdisjoint(columns) or (lag and path[0] == "lag_ns"):
            wanted[path] = columns
    return wanted


def _digits(columns: Columns, name: str) -> npt.NDArray[np.uint64]:
    """Numbers of devices or tables from their 16 hexadecimal digits; a missing text is 0, unknown."""
    rows, texts = columns.texts(name)
    for text in texts:
        if not (isinstance(text, str) and re.fullmatch("[0-9a-fA-F]{16}|0|", text)):
            message = f"{name} has {text!r}, give 16 hexadecimal digits; read the column as text, with dtype={{'{name}': str}}"
            raise TypeError(message)
    # A missing text has the number -1, so it takes the last value.
    numbers: npt.NDArray[np.uint64] = np.array([*(int(str(text) or "0", 16) for text in texts), 0], np.uint64)[rows]
    return numbers


def _flags(columns: Columns, name: str) -> npt.NDArray[np.uint64]:
    """Flags from their names, joined by |; a missing text is 0."""
    rows, texts = columns.texts(name)
    flags: npt.NDArray[np.uint64] = np.array([*(_bits(name, text) for text in texts), 0], np.uint64)[rows]
    return flags


def _bits(name: str, text: object) -> int:
    known = {flag: bit for bit, flag in _NAMES}
    flags = 0
    for part in str(text).split("|") if text not in ("", "-") else ():
        if part not in known:
            raise ValueError(f"{name} has {text!r}, give names of flags joined by |, or - for none")
        flags |= known[part]
    return flags


def _position(columns: Columns) -> npt.NDArray[Any]:
    """Numbers of positions. While the turntable moves, the field is empty in a file, missing in a frame, and -1 in an array."""
    number = columns.values("position")
    return np.where(np.isnan(number), -1.0, number) if number.dtype.kind == "f" else number


def _parts(columns: Columns, dtype: np.dtype[np.void]) -> dict[Path, Any]:
    """The columns of a recording by value: a list of three columns for a value of three sensors, else of one."""
    twice = [name for index, name in enumerate(columns.names) if name in columns.names[:index]]
    if twice:
        raise ValueError(f"the column {twice[0]} is there twice")
    names = set(columns.names)
    wanted = _wanted(names, dtype)
    missing = [column for of_value in wanted.values() for column in of_value if column not in names]
    if missing:
        rows = "increments" if dtype == INCREMENT else "raw samples"
        raise ValueError(f"missing columns: {', '.join(missing)}; is this a recording of {rows}?")

    def part(path: Path, of_value: list[str]) -> list[npt.NDArray[Any]]:
        match path:
            case ("device" | "table",):
                return [_digits(columns, path[0])]
            case ("flags",):
                if "flag_bits" in names:
                    return [columns.values("flag_bits")]
                flags = _flags(columns, "flags")
                return [flags | _flags(columns, "delivery") if "delivery" in names else flags]
            case ("position",):
                return [_position(columns)]
        return [columns.values(column) for column in of_value]

    return {path: part(path, of_value) for path, of_value in wanted.items()}


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


def _assembled(parts: Mapping[Path, Any], count: int, dtype: np.dtype[np.void]) -> Records:
    """Records assembled from values, which are arrays or lists of columns."""
    records = np.zeros(count, dtype)
    if "gyroscopes" in (dtype.names or ()) and not any(path[0] == "gyroscopes" for path in parts):
        for name in ("head_temperature", "board_temperature"):
            records["gyroscopes"][name] = np.nan
    if dtype == INCREMENT and ("angle_increment",) not in parts:
        records["angle_increment"] = np.nan
    for path, part in parts.items():
        name, field = ".".join(path), at(records, path)
        if isinstance(part, list):
            for axis, column in enumerate(part):
                place = field if field.ndim == 1 else field[:, axis]
                place[...] = _exact(name, column, field.dtype)
        else:
            if part.shape != field.shape:
                raise TypeError(f"{name} has the shape {part.shape[1:]} in each record, give {field.shape[1:]}")
            field[...] = _exact(name, part, field.dtype)
    return records


def _given(array: Records, dtype: np.dtype[np.void]) -> dict[Path, Any]:
    """The values of an array that has the fields of `dtype`, or all that are not optional. Of a triad that is there, all belong together."""
    parts, missing = {}, []
    for path in paths(dtype):
        inner: np.dtype[Any] = array.dtype
        for name in path:
            if inner.names is None or name not in inner.names:
                if name not in OPTIONAL:
                    missing.append(".".join(path))
                break
            inner = inner[name]
        else:
            parts[path] = at(array, path)
    if missing:
        raise TypeError(f"missing fields: {', '.join(missing)}")
    return parts


def records(values: object, dtype: np.dtype[np.void]) -> Records:
    """`values` as contiguous records: without a copy if they are contiguous records already, else from their fields or columns."""
    if (columns := columns_of(values)) is not None:
        return _assembled(_parts(columns, dtype), columns.count, dtype)
    if not isinstance(values, (np.ndarray, np.void)):
        raise TypeError(f"give a structured array or a data frame, not {type(values).__name__}")
    array = np.asarray(values)
    if array.dtype == dtype:
        return np.asarray(array, order="C")
    if array.dtype.names is None:
        raise TypeError(f"give a structured array with the fields of {dtype.names}, not one of {array.dtype}")
    flat = array.reshape(-1)
    return _assembled(_given(flat, dtype), flat.size, dtype).reshape(array.shape)


def rows_of(values: object, dtype: np.dtype[np.void]) -> Records:
    """As `records`, of rows in their order: of one dimension, or a single row."""
    array = records(values, dtype)
    if array.ndim > 1:
        raise ValueError(f"the array has the shape {array.shape}, give one of one dimension: its rows in their order")
    return array.reshape(-1)


def as_bytes(array: Records) -> npt.NDArray[np.uint8]:
    """The bytes of contiguous records, without a copy."""
    return array.reshape(-1).view(np.uint8)


def sample_bytes(samples: object) -> npt.NDArray[np.uint8]:
    """Raw samples as bytes."""
    return as_bytes(rows_of(samples, RAW_SAMPLE))


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


def doubles(name: str, values: Any) -> npt.NDArray[np.float64]:
    """Numbers in one dimension as a contiguous array of doubles. `name` is theirs in messages."""
    array = np.ascontiguousarray(values, dtype=np.float64)
    if np.ndim(values) != 1:
        raise ValueError(f"{name} has the shape {np.shape(values)}, give numbers in one dimension")
    return array


def increments_frame(increments: Records, index: pd.Index[Any], gyroscopes: bool) -> pd.DataFrame:
    """Increments as a data frame with the columns of a recording; those of the angles only for a table with gyroscopes."""
    import pandas as pd

    data: dict[str, Any] = {name: increments[name] for name in ("sequence", "timestamp_ns", "interval_ns")}
    data |= {f"a{axis + 1}_dv": increments["velocity_increment"][:, axis] for axis in range(3)}
    if gyroscopes:
        data |= {f"g{axis + 1}_da": increments["angle_increment"][:, axis] for axis in range(3)}
    tables, table = np.unique(increments["table"], return_inverse=True)
    flags, flag = np.unique(increments["flags"] & np.uint64(SAMPLE_FLAGS), return_inverse=True)
    names = [f"{value:016x}" for value in tables.tolist()]
    data["table"] = pd.Categorical.from_codes(table, dtype=pd.CategoricalDtype(names))
    names = ["|".join(flag_names(value)) or "-" for value in flags.tolist()]
    data["flags"] = pd.Categorical.from_codes(flag, dtype=pd.CategoricalDtype(names))
    return pd.DataFrame(data, index=index)
