"""Calibration at one attitude, while the IMU warms up or cools: what PX4 and ArduPilot call temperature calibration."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from . import _isotherm
from ._arguments import check, texts
from ._convert import foreign, part
from ._isotherm import Table
from ._offline import Calibration, fit_options, recorded
from ._paths import AnyPath
from ._progress import Progress, shown
from ._records import Records
from ._times import Moment

if TYPE_CHECKING:
    import pandas as pd


def calibrate_warm_up(
    recordings: AnyPath | Records | pd.DataFrame | Sequence[AnyPath | Records | pd.DataFrame],
    imu: str,
    *,
    nominal: Table | None = None,
    order: int | Literal["auto"] = "auto",
    lag: float | Literal["none"] | None = None,
    at: float | None = None,
    gravity_reference: float | None = None,
    beside: Iterable[Literal["px4", "ardupilot"]] = (),
    accept: Iterable[str] = (),
    strict: bool = False,
    other_device: bool = False,
    mapping: AnyPath | Mapping[str, Any] | None = None,
    temperature: float | None = None,
    interval: float | None = None,
    topic: str | None = None,
    gyroscope_topic: str | None = None,
    temperature_topic: str | None = None,
    gyroscope_file: AnyPath | None = None,
    time: Literal["header", "log", "rate"] = "header",
    instance: int | None = None,
    start: Moment | None = None,
    end: Moment | None = None,
    progress: Progress = False,
) -> Calibration:
    """Makes bias curves of recordings at one attitude, as `isotherm calibrate warm-up` does.

    `recordings` is one recording or a list: arrays of RAW_SAMPLE, data frames with the columns of a recording, or paths of files. A file may be of
    another program, such as a ULog or a DataFlash log: `mapping` to `instance` are then those of `convert`. A log with several IMUs needs
    `instance`; `calibrate_vehicle` makes the tables of all.

    `start` and `end` leave out what is before and after: seconds since the begin of each recording, or a time stamp as the command takes it
    ("12500000000ns").

    `nominal` is the table that gives everything but the bias curves. Only files of readings need none: their resolution makes it, with 1 g0 =
    `gravity_reference` [m/s2], 9.80665 unless given. `lag` is the time constant [s], or "none"; it is found without it. Accelerometers keep the bias of the nominal table
    at the temperature `at`, mid range unless given. `beside` names autopilots whose cubics are in the document and the report. `accept` and
    `strict` are as those of `calibrate_turntable`, and so is `progress`. Raises CalibrationError with what was found.

    >>> isotherm.calibrate_warm_up("warm-up.BIN", "imu-c", lag="none").table.temperature_unit
    'degC'
    """
    options = warm_up_options(
        order,
        lag,
        at,
        gravity_reference,
        beside,
        accept,
        strict,
        other_device,
        (mapping, temperature, interval, topic, gyroscope_topic, temperature_topic, gyroscope_file, time, instance),
        (start, end),
    )
    given = recorded(recordings)
    with shown(progress, "calibrate") as callback:
        return Calibration(_isotherm.calibrate_warm_up(given, imu, nominal, gravity_reference, options, callback))


def warm_up_options(
    order: int | Literal["auto"],
    lag: float | Literal["none"] | None,
    at: float | None,
    gravity_reference: float | None,
    beside: Iterable[str],
    accept: Iterable[str],
    strict: bool,
    other_device: bool,
    given: tuple[Any, ...],
    ends: tuple[Moment | None, Moment | None],
) -> dict[str, Any]:
    """The options of a fit at one attitude. Raises ValueError for what cannot be."""
    check(at=at, gravity_reference=gravity_reference)
    for name, value in (("at", at), ("gravity_reference", gravity_reference)):
        if value is not None and not math.isfinite(value):
            raise ValueError(f"{name} is {value}, give a finite number")
    if gravity_reference is not None and not 9.7 <= gravity_reference <= 9.9:
        raise ValueError(f"gravity_reference is {gravity_reference}, give 9.7 to 9.9 m/s2")
    if lag == 0:
        raise ValueError('lag is 0, give a time constant in s, or "none"')
    return fit_options(
        order=order,
        accept=accept,
        strict=strict,
        other_device=other_device,
        lag=0.0 if lag == "none" else lag,
        at=at,
        beside=texts("beside", beside),
        foreign=foreign(*given),
        part=part(*ends),
    )
