"""Data of other programs as raw samples, and increments as ROS messages: `isotherm convert` and `isotherm replay -o FILE.mcap`."""

from __future__ import annotations

import csv
import io
import os
import warnings
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from . import _isotherm
from ._isotherm import Table
from ._records import INCREMENT, RAW_SAMPLE, Records, as_bytes, records, sample_bytes
from ._toml import toml_value

if TYPE_CHECKING:
    import pandas as pd

AnyPath: TypeAlias = str | os.PathLike[str]
# Seconds since the begin of a recording, or a time stamp as the command takes it.
Moment: TypeAlias = float | str


def convert(
    source: AnyPath | pd.DataFrame | npt.NDArray[Any] | Mapping[str, npt.ArrayLike],
    mapping: AnyPath | Mapping[str, Any] | None = None,
    *,
    temperature: float | None = None,
    interval: float | None = None,
    topic: str | None = None,
    gyroscope_topic: str | None = None,
    temperature_topic: str | None = None,
    gyroscope_file: AnyPath | None = None,
    time: Literal["header", "log", "rate"] = "header",
    session: int = 0,
    instance: int | None = None,
    start: Moment | None = None,
    end: Moment | None = None,
) -> Records:
    """Raw samples, as RAW_SAMPLE, of data from other programs, as `isotherm convert` makes them.

    `source` is the path of a file (text, NovAtel log, MCAP, ULog, DataFlash), or a table: a data frame, an array with named fields, a mapping of columns, or an
    array of two dimensions, whose columns have numbers from 1. Each number is taken as the shortest decimal number that reads back to it, as in a
    file. Columns of floats are not of whole numbers, so that their resolution is 1e-6 unless it is given; times of datetime64 are in ns.

    `mapping` is the path of a mapping file, or a mapping with the same keys. `temperature`, `interval` [s], `topic`, `gyroscope_topic`,
    `temperature_topic`, `gyroscope_file`, `time`, `session` and `instance` are the options of the command; `start` and `end` are its `--from` and `--to`: seconds since the begin of the data, or a
    time stamp ("12500000000ns", "2026-05-01T12:34:56Z"). What the command warns of, such as gaps, is a UserWarning.

    Raises ValueError without a mapping where one is needed, with the mapping that would be; TableError with all faults of a mapping; and
    RecordingFault if the data are wrong.
    """
    if isinstance(mapping, Mapping) and isinstance(source, np.ndarray) and source.dtype.names is None:
        mapping = {"header": False} | dict(mapping)
    text, interval_ns = known(mapping, temperature, interval)
    data = source if isinstance(source, (str, os.PathLike)) else table_csv(source)
    origin = topic, gyroscope_topic, temperature_topic, gyroscope_file, _time(time)
    samples, findings = _isotherm.convert(data, text, temperature, interval_ns, origin, session, instance, part(start, end))
    for finding in findings:
        warnings.warn(finding, stacklevel=2)
    return samples.view(RAW_SAMPLE)


def known(
    mapping: AnyPath | Mapping[str, Any] | None, temperature: float | None, interval: float | None
) -> tuple[tuple[AnyPath, str] | None, int | None]:
    """Name and text of a mapping, and the interval in ns; raises ValueError if the temperature or the interval cannot be."""
    text: tuple[AnyPath, str] | None = None
    if isinstance(mapping, Mapping):
        text = ("mapping", mapping_toml(mapping))
    elif mapping is not None:
        text = (mapping, _isotherm.read_text(mapping))
    if temperature is not None and not np.isfinite(temperature):
        raise ValueError(f"temperature is {temperature}, give a finite number")
    if interval is None:
        return text, None
    if not 1e-6 <= interval <= 3600.0:
        raise ValueError(f"interval is {interval}, give 0.000001 to 3600 s")
    return text, round(interval * 1e9)


def part(start: Moment | None, end: Moment | None) -> tuple[str | None, str | None]:
    """The option `part` of a fit."""
    start, end = (moment if moment is None or isinstance(moment, str) else repr(float(moment)) for moment in (start, end))
    return start, end


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
    """
    data = as_bytes(records(increments, INCREMENT))
    raw = None if samples is None else sample_bytes(samples)
    if raw is not None and len(raw) // RAW_SAMPLE.itemsize != len(data) // INCREMENT.itemsize:
        raise ValueError("samples and increments must be of one length")
    _isotherm.write_ros(path, table, data, raw, table_file)


def table_csv(table: Any) -> bytes:
    """A table as the text of a CSV file; that of an array of two dimensions has no header."""
    if isinstance(table, np.ndarray) and table.dtype.names is None:
        if table.ndim != 2:
            raise ValueError(f"an array of {table.ndim} dimensions; give one of two, or with named fields")
        columns, header = list(table.T), None
    else:
        names = table.dtype.names if isinstance(table, np.ndarray) else list(table.keys())
        columns, header = [np.asarray(table[name]).ravel() for name in names], [str(name) for name in names]
    if len({len(column) for column in columns}) > 1:
        raise ValueError("the columns must be of one length")
    text = io.StringIO()
    if header is not None:
        csv.writer(text, lineterminator="\n", quoting=csv.QUOTE_ALL).writerow(header)
    csv.writer(text, lineterminator="\n").writerows(zip(*map(_texts, columns), strict=True))
    return text.getvalue().encode()


def _texts(column: npt.NDArray[Any]) -> Sequence[str]:
    """The numbers of a column; a time is in ns."""
    if column.dtype.kind == "M":
        column = column.astype("datetime64[ns]").astype(np.int64)
    if column.dtype == np.float32:
        return [str(value) for value in column]
    return [value if isinstance(value, str) else repr(value) for value in column.tolist()]


def mapping_toml(mapping: Mapping[str, Any]) -> str:
    """A mapping as the text of a mapping file."""
    plain = {"format": 1} | {key: value for key, value in mapping.items() if not isinstance(value, Mapping)}
    lines = [f"{key} = {toml_value(value)}" for key, value in plain.items()]
    for name, section in mapping.items():
        if isinstance(section, Mapping):
            lines += [f"[{name}]", *(f"{key} = {toml_value(value)}" for key, value in section.items() if value is not None)]
    return "\n".join(lines) + "\n"
