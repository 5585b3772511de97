"""Calibration and verification without a turntable: the device is tumbled, and the length of gravity is the reference."""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from . import _isotherm
from ._arguments import check
from ._convert import foreign, part
from ._documents import Lengths
from ._isotherm import Table
from ._offline import Calibration, campaign_text, fit_options, recorded
from ._paths import AnyPath
from ._progress import Progress, shown
from ._records import Records, sample_bytes
from ._times import Moment

if TYPE_CHECKING:
    import pandas as pd


def calibrate_tumble(
    campaign: AnyPath | Mapping[str, Any],
    recordings: AnyPath | Records | pd.DataFrame | Sequence[AnyPath | Records | pd.DataFrame] | None = None,
    *,
    order: int | Literal["auto"] = "auto",
    scale_factor: Literal["auto", "single", "split"] = "auto",
    misalignment: bool = True,
    window: float | None = None,
    exclude: Iterable[int] = (),
    temperature_range: tuple[float, float] | None = None,
    latitude: float | None = None,
    height: float | None = None,
    accept: Iterable[str] = (),
    strict: bool = False,
    other_device: bool = False,
    imu: str | None = None,
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
    """Makes a table of recordings of a tumble, as `isotherm calibrate tumble` does.

    `campaign` is the path of a campaign file with `method = "gravity-only"`, or a mapping with `imu`, `gravity_local`, `gravity_reference` [m/s2] and
    `temperature_unit`. `recordings` is one recording or a list: arrays of RAW_SAMPLE, data frames with the columns of a recording, or paths of
    files. Without them the files that the campaign names are read. A file may be of another program: `mapping` to `instance` are then those of
    `convert`. `start` and `end` leave out what is before and after in each recording, as those of `convert`.

    `window` [s] is that of the search for static poses, 0.5 or 1 s without it. `exclude` lists numbers of static_poses. Where the temperature is
    constant, `temperature_range` states where the table is valid. `latitude` [deg], north positive, with `height` [m] checks the `gravity_local` of a
    mapping, or gives normal gravity where it has none: its 102 ppm (95 %) are then in the intervals of the scale factors. `imu` chooses one of a campaign file with `imus`. `accept` and `strict` are as
    those of `calibrate_turntable`, and so is `progress`. Raises CalibrationError with the parameters that the attitudes do not determine.

    >>> facts = {"imu": "imu-x", "gravity_local": 9.81, "gravity_reference": 9.81, "temperature_unit": "degC"}
    >>> calibration = isotherm.calibrate_tumble(facts, "tumble.csv", temperature_range=(0.0, 50.0))
    >>> len(calibration.dwells), calibration.summary["static_poses"]
    (40, 40)
    """
    check(imu=imu, latitude=latitude, height=height)
    _positive("window", window)
    if temperature_range is not None and not (hasattr(temperature_range, "__len__") and len(temperature_range) == 2):
        raise TypeError(f"temperature_range is {temperature_range!r}, give its lower and its upper end, for example (0.0, 50.0)")
    if temperature_range is not None and not -math.inf < temperature_range[0] < temperature_range[1] < math.inf:
        raise ValueError(f"temperature_range is {temperature_range}, give the lower end first")
    place = _place(campaign, latitude, height)
    if isinstance(campaign, Mapping):
        stated = place is None or "gravity_local" in campaign
        of_place = {} if stated else {"latitude_deg": latitude, "height_m": height}
        campaign = {"format": 1, "method": "gravity-only"} | dict(campaign) | of_place
    text, path = campaign_text(campaign)
    given = None if recordings is None else recorded(recordings)
    options = fit_options(
        order=order,
        accept=accept,
        strict=strict,
        other_device=other_device,
        window=window,
        scale_factor=scale_factor,
        misalignment=misalignment,
        static_poses=_numbers(exclude),
        temperature_range=temperature_range,
        place=place,
        foreign=foreign(mapping, temperature, interval, topic, gyroscope_topic, temperature_topic, gyroscope_file, time, instance),
        part=part(start, end),
    )
    with shown(progress, "calibrate") as callback:
        return Calibration(_isotherm.calibrate_campaign(text, path, imu, given, True, options, callback))


def lengths(
    table: Table,
    samples: Records | pd.DataFrame,
    *,
    window: float | None = None,
    gravity_local: float | None = None,
    other_device: bool = False,
    require: str | None = None,
    recording: str = "array",
    progress: Progress = False,
) -> Lengths:
    """Compares the length of the output over each static pose with local gravity: the document of `isotherm verify --static-poses --json`.

    `gravity_local` [m/s2] is that of the table's provenance unless given. `require` is as that of the command, for example "scale=500ppm"; the document
    has `met` and the judgements. Samples of another device than the table's are refused, unless `other_device`. Raises StabilityError if there are no static_poses, or if local gravity is unknown.

    >>> facts = {"imu": "imu-x", "gravity_local": 9.81, "gravity_reference": 9.81, "temperature_unit": "degC"}
    >>> table = isotherm.calibrate_tumble(facts, "tumble.csv", temperature_range=(0.0, 50.0)).table
    >>> found = isotherm.lengths(table, isotherm.read_recording("tumble.csv"), require="scale=500ppm")
    >>> found["static_poses"], found["met"]  # this recording made the table, so it is no evidence
    (40, False)
    """
    _positive("window", window)
    if gravity_local is not None and not 9.7 <= gravity_local <= 9.9:
        raise ValueError(f"gravity_local is {gravity_local}, give 9.7 to 9.9 m/s2")
    data = sample_bytes(samples)
    with shown(progress, "lengths") as callback:
        return Lengths(*_isotherm.lengths(table, data, window, gravity_local, other_device, require, recording, callback))


def _place(campaign: AnyPath | Mapping[str, Any], latitude: float | None, height: float | None) -> tuple[float, float] | None:
    """Latitude and height, if they are given."""
    if latitude is None and height is None:
        return None
    if latitude is None or height is None:
        raise ValueError("give both latitude and height, or neither")
    if not isinstance(campaign, Mapping):
        raise ValueError("latitude and height are for a mapping; the campaign file has the keys latitude_deg and height_m")
    for name, value, low, high, unit in (("latitude", latitude, -90, 90, "deg"), ("height", height, -1000, 9000, "m")):
        if not low <= value <= high:
            raise ValueError(f"{name} is {value}, give {low} to {high} {unit}")
    return float(latitude), float(height)


def _numbers(exclude: Iterable[int]) -> list[int]:
    """The static poses that are left out."""
    try:
        numbers = [operator.index(number) for number in exclude]
        if all(number >= 1 for number in numbers):
            return numbers
    except TypeError:
        pass
    raise ValueError(f"exclude is {exclude!r}, give numbers of static poses from 1 in a list, for example [12]")


def _positive(name: str, seconds: float | None) -> None:
    check(**{name: seconds})
    if seconds is not None and not 0.0 < seconds <= 1e6:
        raise ValueError(f"{name} is {seconds}, give seconds over 0 and up to 1e6")
