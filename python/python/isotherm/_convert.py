"""Third-party data as raw samples, and increments as ROS messages: `isotherm convert` and `isotherm replay -o FILE.mcap`."""

from __future__ import annotations

import csv
import io
import os
import warnings
from collections.abc import Mapping, Sequence
from datetime import timedelta
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from . import _isotherm
from ._arguments import check
from ._isotherm import Table
from ._columns import columns_of, is_arrow, is_frame
from ._paths import AnyPath
from ._records import INCREMENT, RAW_SAMPLE, Records, as_bytes, rows_of, sample_bytes
from ._times import Moment, is_time, moment_text, ns_of, whole_ns
from ._toml import toml_value

if TYPE_CHECKING:
    import pandas as pd



def convert(
    source: AnyPath | pd.DataFrame | npt.NDArray[Any] | Mapping[str, npt.ArrayLike],
    mapping: AnyPath | Mapping[str, Any] | None = None,
    *,
    temperature: float | None = None,
    interval: float | timedelta | None = None,
    topic: str | None = None,
    gyroscope_topic: str | None = None,
    temperature_topic: str | None = None,
    gyroscope_file: AnyPath | None = None,
    time: Literal["header", "log", "rate"] = "header",
    session: int = 0,
    instance: int | None = None,
    start: Moment | None = None,
    end: Moment | None = None,
    table: Table | None = None,
) -> Records:
    """Raw samples, as RAW_SAMPLE, of data from other programs, as `isotherm convert` makes them.

    `source` is the path of a file (text, NovAtel log, MCAP, ULog, DataFlash), or a table: a data frame, an array with named fields, a mapping of columns, or an
    array of two dimensions, whose columns have numbers from 1. Each number is taken as the shortest decimal number that reads back to it, as in a
    file. Columns of floats are not of whole numbers, so that their resolution is 1e-6 unless it is given.

    A column of times may be of datetime64, timedelta64, datetime, timedelta, or of the times of pandas, with or without a time zone: it is read in
    ns, since 1970 in UTC, and `time.unit` may be left out. A DatetimeIndex or TimedeltaIndex of a data frame is a column, too, with the name of the
    index, or "time". Messages count rows from 0.

    Readings become pulses of the nominal interval of `table`, whatever interval the data have; without a table, of their own. Give it for samples
    that are replayed with it.

    `mapping` is the path of a mapping file, or a mapping with the same keys. `temperature`, `interval` [s], `topic`, `gyroscope_topic`,
    `temperature_topic`, `gyroscope_file`, `time`, `session` and `instance` are the options of the command; `start` and `end` are its `--from` and `--to`: seconds since the begin of the data, or a
    time stamp ("12500000000ns", "2026-05-01T12:34:56Z"); or a timedelta, or a datetime, also of NumPy and pandas. What the command warns of, such as gaps, is a UserWarning.

    Raises ValueError without a mapping where one is needed, with the mapping that would be; TableError with all faults of a mapping; and
    RecordingFault if the data are wrong.

    >>> rows = np.array([[0.0, 0.1, -0.2, 9.8, 21.0], [0.01, 0.1, -0.2, 9.8, 21.0]])
    >>> mapping = {
    ...     "time": {"column": 1, "unit": "s", "interval_s": 0.01},
    ...     "accelerometer": {"columns": [2, 3, 4], "kind": "reading", "unit": "m/s2", "resolution": 1e-6},
    ...     "temperature": {"columns": [5, 5, 5]},
    ... }
    >>> isotherm.convert(rows, mapping)["accelerometers"]["positive_pulses"][1]
    array([ 100000,       0, 9800000], dtype=uint32)
    """
    if isinstance(mapping, Mapping) and isinstance(source, np.ndarray) and source.dtype.names is None:
        mapping = {"header": False} | dict(mapping)
    data: AnyPath | bytes
    first_row: int | None = None
    if isinstance(source, (str, os.PathLike)):
        data = source
    else:
        columns, names = table_columns(source)
        mapping = with_unit_of_times(mapping, columns, names)
        data, first_row = table_csv(columns, names), 1 if names is None else 2
    text, interval_ns = known(mapping, temperature, interval)
    origin = topic, gyroscope_topic, temperature_topic, gyroscope_file, _time(time)
    samples, findings = _isotherm.convert(data, first_row, text, temperature, interval_ns, origin, session, instance, part(start, end), table)
    for finding in findings:
        warnings.warn(finding, stacklevel=2)
    return samples.view(RAW_SAMPLE)


def known(
    mapping: AnyPath | Mapping[str, Any] | None, temperature: float | None, interval: float | timedelta | None
) -> tuple[tuple[AnyPath, str] | None, int | None]:
    """Name and text of a mapping, and the interval in ns; raises ValueError if the temperature or the interval cannot be."""
    text: tuple[AnyPath, str] | None = None
    if isinstance(mapping, Mapping):
        text = ("mapping", mapping_toml(mapping))
    elif mapping is not None:
        text = (mapping, _isotherm.read_text(mapping))
    check(temperature=temperature)
    if not is_time(interval):
        check(interval=interval)
    if temperature is not None and not np.isfinite(temperature):
        raise ValueError(f"temperature is {temperature}, give a finite number")
    if interval is None:
        return text, None
    interval_ns = ns_of(interval) if isinstance(interval, timedelta) else interval * 1e9
    if not 1e3 <= interval_ns <= 3600e9:
        raise ValueError(f"interval is {interval}, give 0.000001 to 3600 s")
    return text, round(interval_ns)


def part(start: Moment | None, end: Moment | None) -> tuple[str | None, str | None]:
    """The option `part` of a fit."""
    return moment_text(start), moment_text(end)


def foreign(
    mapping: AnyPath | Mapping[str, Any] | None,
    temperature: float | None,
    interval: float | None,
    topic: str | None,
    gyroscope_topic: str | None,
    temperature_topic: str | None,
    gyroscope_file: AnyPath | None,
    time: Literal["header", "log", "rate"],
    instance: int | None,
) -> tuple[Any, ...]:
    """The option `foreign` of a fit."""
    text, interval_ns = known(mapping, temperature, interval)
    return text, temperature, interval_ns, (topic, gyroscope_topic, temperature_topic, gyroscope_file, _time(time)), instance


def _time(time: Literal["header", "log", "rate"]) -> Literal["header", "log", "rate"]:
    if time not in ("header", "log", "rate"):
        raise ValueError(f'time is {time!r}, give "header", "log" or "rate"')
    return time


def write_ros(
    path: AnyPath,
    table: Table,
    increments: Records,
    *,
    samples: Records | pd.DataFrame | None = None,
    table_file: AnyPath = "",
) -> None:
    """Writes increments of an IMU as sensor_msgs/msg/Imu in MCAP, as `isotherm replay` does with a file named .mcap.

    A metadata record names `table`, which has computed them, and `table_file`, the name of its file. With the `samples` of the increments, in the
    same order, the head temperature becomes sensor_msgs/msg/Temperature, if the table's temperature is in degC.

    >>> table = isotherm.Table.load("imu-a.toml")
    >>> increments = isotherm.replay(table, isotherm.read_recording("run.csv"))
    >>> isotherm.write_ros("imu.mcap", table, increments, table_file="imu-a.toml")
    """
    data = as_bytes(rows_of(increments, INCREMENT))
    raw = None if samples is None else sample_bytes(samples)
    if raw is not None and len(raw) // RAW_SAMPLE.itemsize != len(data) // INCREMENT.itemsize:
        raise ValueError("samples and increments must be of one length")
    _isotherm.write_ros(path, table, data, raw, table_file)


def table_columns(table: Any) -> tuple[list[Any], list[str] | None]:
    """The columns of a table, and their names; those of an array of two dimensions have none."""
    if isinstance(table, np.ndarray) and table.dtype.names is None:
        if table.ndim != 2:
            raise ValueError(f"an array of {table.ndim} dimensions; give one of two, or with named fields")
        return list(table.T), None
    if is_arrow(table) and (read := columns_of(table)) is not None:
        return [read.values(name) for name in read.names], read.names
    names = list(table.dtype.names if isinstance(table, np.ndarray) else table.keys())
    named = [(str(name), table[name]) for name in names]
    # Without pandas: only its indices of times have such a type.
    if is_frame(table) and str(table.index.dtype).startswith(("datetime64", "timedelta64")):
        name = "time" if table.index.name is None else str(table.index.name)
        if name not in dict(named):
            named.insert(0, (name, table.index))
    for name, column in named:
        if np.ndim(column) != 1:
            raise ValueError(f"{name} has the shape {np.shape(column)}, give columns of one dimension")
    if len({len(column) for _, column in named}) > 1:
        raise ValueError("the columns must be of one length")
    return [column for _, column in named], [name for name, _ in named]


def with_unit_of_times(mapping: Any, columns: list[Any], names: list[str] | None) -> Any:
    """The mapping with the unit of its column of the time, if that has times, which are in ns."""
    time = mapping.get("time") if isinstance(mapping, Mapping) else None
    if not isinstance(time, Mapping) or "column" not in time:
        return mapping
    named = dict(zip(names if names is not None else range(1, len(columns) + 1), columns, strict=True))
    column = named.get(time["column"])
    if column is None or "unit" in time and time["unit"] == "ns" or whole_ns(str(time["column"]), column[:1]) is None:
        return mapping
    if "unit" in time:
        raise ValueError(f"time.unit is {time['unit']!r}, but {time['column']} has times, which are read in ns; leave it out")
    return dict(mapping) | {"time": dict(time) | {"unit": "ns"}}


def table_csv(columns: list[Any], names: list[str] | None) -> bytes:
    """The text of a CSV file with these columns; without names it has no header."""
    text = io.StringIO()
    if names is not None:
        csv.writer(text, lineterminator="\n", quoting=csv.QUOTE_ALL).writerow(names)
    shown = [str(index) for index in range(1, len(columns) + 1)] if names is None else names
    csv.writer(text, lineterminator="\n").writerows(zip(*map(_texts, shown, columns), strict=True))
    return text.getvalue().encode()


def _texts(name: str, column: Any) -> Sequence[str]:
    """The numbers of a column; a time is in ns."""
    times = whole_ns(name, column)
    values = np.asarray(column) if times is None else times
    if values.dtype == np.float32:
        return [str(value) for value in values]
    return [value if isinstance(value, str) else repr(value) for value in values.tolist()]


def mapping_toml(mapping: Mapping[str, Any]) -> str:
    """A mapping as the text of a mapping file."""
    plain = {"format": 1} | {key: value for key, value in mapping.items() if not isinstance(value, Mapping)}
    lines = [f"{key} = {toml_value(value)}" for key, value in plain.items()]
    for name, section in mapping.items():
        if isinstance(section, Mapping):
            lines += [f"[{name}]", *(f"{key} = {toml_value(value)}" for key, value in section.items() if value is not None)]
    return "\n".join(lines) + "\n"
