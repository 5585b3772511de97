"""The offline tools: the commands of the same names, for arrays and data frames. The Rust libraries do the arithmetic."""

from __future__ import annotations

import json
import math
import operator
import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, overload

import numpy as np
import numpy.typing as npt

from . import _isotherm
from ._arguments import KINDS, check, texts
from ._columns import is_arrow, is_frame
from ._convert import part
from ._curves import Curve, by_name
from ._documents import AxesNoise, Noise, RateNoise
from ._errors import NoiseError
from ._files import write_text, write_together
from ._isotherm import Batch, Comparison, Stability, Table
from ._paths import AnyPath, is_path, paths
from ._progress import Progress, shown
from ._rates import noise_of_axes
from ._records import CAMPAIGN, INCREMENT, RAW_SAMPLE, Records, as_bytes, doubles, increments_frame, records, rows_of, sample_bytes
from ._times import Moment
from ._toml import toml_value

if TYPE_CHECKING:
    import pandas as pd

QUANTITIES = ("bias", "positive_scale_factor", "negative_scale_factor")
SENSORS = ("A1", "A2", "A3", "G1", "G2", "G3")
# The sections of a campaign file of which there may be several.
LISTS = ("imus", "position", "turn", "ramp")


@overload
def replay(table: Table, samples: Records, *, progress: Progress = False) -> Records: ...
@overload
def replay(table: Table, samples: pd.DataFrame, *, progress: Progress = False) -> pd.DataFrame: ...
def replay(table: Table, samples: Records | pd.DataFrame, *, progress: Progress = False) -> Records | pd.DataFrame:
    """The increments of raw samples, bit for bit those of the service; `latency_ns` is 0.

    An array gives an array of the same shape. A data frame with the columns of a recording gives one with the columns of
    recorded increments and the same index. If the table has a lag and no sample has a `lag_ns`, the lagged temperature is computed from
    the samples, in their order; each session begins soaked. Otherwise the order of the samples does not matter for the increments.

    It warns of samples out of order, which the command refuses, and as the command where the intervals are not the time from sample to sample, where time is lost without a hole in `sequence`, of
    missing samples, and of scale factors that are of another interval. An array names no IMU.

    `progress` is a function of (done, total), in bytes of files or rows of arrays, or True for a bar of tqdm.

    >>> table, samples = isotherm.Table.load("imu-a.toml"), isotherm.read_recording("run.csv")
    >>> increments = isotherm.replay(table, samples)
    >>> increments.shape == samples.shape, increments["velocity_increment"].shape[1]
    (True, 3)
    """
    array = records(samples, RAW_SAMPLE)
    data = as_bytes(array)
    for warning in _isotherm.time_warnings(table, data):
        warnings.warn(warning, stacklevel=2)
    with shown(progress, "replay") as callback:
        increments = _isotherm.replay(table, data, callback).view(INCREMENT)
    if is_frame(samples):
        return increments_frame(increments, samples.index, table.gyroscopes is not None)  # type: ignore[union-attr]
    return increments.reshape(array.shape)


def read_recording(
    recording: AnyPath | Sequence[AnyPath], *, imu: str | None = None, start: Moment | None = None, end: Moment | None = None
) -> Records:
    """The raw samples of a recording (CSV, MCAP), as RAW_SAMPLE. The format is recognised by what is in the file.

    `recording` is a path, or several of the pieces of one recording, in any order: a piece goes on with the session before it where its time
    does. A pattern such as "flight*.mcap" stands for the files that it fits. `imu` is the one that is read, where a recording has several.
    `start` and `end` leave out what is before and after, as those of `convert`. What is damaged and left out, and what
    is missing at the end of a file, is a UserWarning.

    Raises RecordingFault if the data are wrong, such as rows out of order.

    >>> samples = isotherm.read_recording("run.csv")
    >>> samples.dtype == isotherm.RAW_SAMPLE, samples["accelerometers"]["head_temperature"].shape[1]
    (True, 3)
    """
    data, found = _isotherm.read_recording(paths(recording), imu, part(start, end))
    for warning in found:
        warnings.warn(warning, stacklevel=2)
    return data.view(RAW_SAMPLE)


def read_increments(path: AnyPath, *, imu: str | None = None) -> Records:
    """The increments that `isotherm feed`, `replay` or `record` wrote (CSV, MCAP), as INCREMENT. What the file does not have is 0, as
    `session` and `latency_ns` of `replay`. `imu` is the one that is read, where a file has several.

    >>> increments = isotherm.replay(isotherm.Table.load("imu-a.toml"), isotherm.read_recording("run.csv"))
    >>> isotherm.write_increments("increments.csv", increments)
    >>> bool((isotherm.read_increments("increments.csv")["velocity_increment"] == increments["velocity_increment"]).all())
    True
    """
    data, found = _isotherm.read_increments(path, imu)
    for warning in found:
        warnings.warn(warning, stacklevel=2)
    return data.view(INCREMENT)


def write_recording(path: AnyPath, samples: Records | pd.DataFrame, *, imu: str = "imu") -> None:
    """Writes raw samples as a recording, in the format that its name says: .csv or .mcap. What is 0 in all samples is left out:
    `session`, `telemetry_ns`, `device`, the lagged temperature and the gyroscopes. MCAP has the name of the IMU, `imu`, too. What no recording gives back is `sent_ns`. A file of this name is replaced.

    >>> samples = isotherm.read_recording("run.csv")
    >>> isotherm.write_recording("copy.csv", samples)
    >>> bool((isotherm.read_recording("copy.csv")["accelerometers"] == samples["accelerometers"]).all())
    True
    """
    _isotherm.write_recording(path, sample_bytes(samples), imu)


def write_increments(path: AnyPath, increments: Records | pd.DataFrame, *, delivery: bool = False, imu: str = "imu") -> None:
    """Writes increments in the format that the name says. As .csv it is what `isotherm replay` writes, or with `delivery` what
    `isotherm feed --delivery` does; .mcap is as `isotherm record` writes increments of `imu`, and has all fields.
    If all angles are NaN, they are left out, as those of a table without gyroscopes. `write_ros` writes ROS messages.

    >>> increments = isotherm.replay(isotherm.Table.load("imu-a.toml"), isotherm.read_recording("run.csv"))
    >>> isotherm.write_increments("increments.csv", increments)
    >>> len(isotherm.read_increments("increments.csv")) == len(increments)
    True
    """
    _isotherm.write_increments(path, as_bytes(rows_of(increments, INCREMENT)), delivery, imu)


def verify(
    table: Table,
    samples: Records | pd.DataFrame,
    *,
    window: float = 10.0,
    attitude: Sequence[float] | None = None,
    angles: Sequence[float] | None = None,
    gravity_local: float | None = None,
    other_device: bool = False,
    accept: Iterable[str] = (),
    recording: str = "array",
    progress: Progress = False,
) -> Stability:
    """Computes how stable the output is, before and after compensation, and how large its errors are, as `isotherm verify` does.

    The figures are of means over `window` seconds. `attitude` is the direction of the specific force along A1, A2, A3. Without it the
    median of the compensated output is used; then only variation and length can be judged. `gravity_local` [m/s2] is that of the
    table's provenance (`Table.gravity_local`) unless given. With neither, only variation and level can be judged. `recording` is the
    name of the samples in messages and in a report.

    Gyroscopes are judged where the table and the samples have them. `angles` are the outer and the inner angle [deg] of the turntable that the
    table's campaign was measured on. With the provenance of the table they give Earth's rate along the gyroscopes, which is taken off, and the
    attitude. Without them only the variation of the gyroscopes is judged. Samples of another device than the table's are refused, unless
    `other_device` is True.

    No bound is met where the run leaves out more than a tenth of a curve's range at one place, unless `accept` has "not-covered".

    `progress` is a function of (done, total), in rows, or True for a bar of tqdm.

    Raises RecordingFault if the samples are out of order, and StabilityError if nothing can be computed. Use `Stability.check` to see whether the table is good enough.

    >>> table = isotherm.calibrate_turntable("campaign/campaign.toml").table
    >>> stability = isotherm.verify(table, isotherm.read_recording("still.csv"), attitude=(0.6, -0.48, 0.64))
    >>> min(stability.factor) > 10.0, stability.warning
    (True, None)
    """
    check(window=window, gravity_local=gravity_local, other_device=other_device)
    if not (math.isfinite(window) and window > 0.0):
        raise ValueError(f"window is {window}, give seconds over 0")
    if gravity_local is not None and not 9.7 <= gravity_local <= 9.9:
        raise ValueError(f"gravity_local is {gravity_local}, give 9.7 to 9.9 m/s2")
    direction = None
    if attitude is not None:
        direction = tuple(float(part) for part in attitude)
        if len(direction) != 3 or not 0.0 < math.hypot(*direction) < math.inf:
            raise ValueError(f"attitude is {attitude}, give three numbers, not all 0")
    turned = None
    if angles is not None:
        turned = tuple(float(angle) for angle in angles)
        if len(turned) != 2 or not all(map(math.isfinite, turned)):
            raise ValueError(f"angles is {angles}, give the outer and the inner angle in degrees")
    names, data = texts("accept", accept), sample_bytes(samples)
    with shown(progress, "verify") as callback:
        return _isotherm.verify(table, data, window, direction, turned, gravity_local, other_device, names, recording, callback)


def regress(
    x: npt.ArrayLike,
    y: npt.ArrayLike,
    *,
    linear: Mapping[str, npt.ArrayLike] | None = None,
    max_order: int | None = None,
    weights: npt.ArrayLike | None = None,
    min_effect: float | None = None,
) -> dict[str, Any]:
    """One polynomial regression with its order table: the document of `isotherm regress --json` as a dictionary.

    The fit is a polynomial of x; `linear` has further columns by name, of the length of x, each with one coefficient: the further --x of the
    command. Each number is taken as the shortest decimal number that reads back to it, as in a file. `diagnostics.outliers` are indices from 0.

    >>> found = isotherm.regress([1.0, 2.0, 3.0, 4.0], [2.1, 3.9, 6.2, 7.8], max_order=1)
    >>> found["selected"], found["n"]
    (1, 4)
    """
    w = None if weights is None else doubles("weights", weights)
    columns = [(name, doubles(name, values)) for name, values in (linear or {}).items()]
    document = json.loads(_isotherm.regress(doubles("x", x), doubles("y", y), w, columns, max_order, min_effect))
    assert isinstance(document, dict)
    return document


@overload
def noise(
    samples: Records | pd.DataFrame,
    *,
    interval: None = None,
    table: Table | None = None,
    start: float = 0.0,
    end: float = math.inf,
    report: AnyPath | None = None,
    kalibr: AnyPath | None = None,
    recording: str = "array",
    progress: Progress = False,
) -> Noise: ...
@overload
def noise(samples: pd.DataFrame, *, interval: float, temperature: Any = None, progress: Progress = False) -> AxesNoise: ...
@overload
def noise(samples: npt.ArrayLike, *, interval: float, temperature: npt.ArrayLike | None = None, progress: Progress = False) -> RateNoise: ...
def noise(
    samples: Records | pd.DataFrame | npt.ArrayLike,
    *,
    interval: float | None = None,
    temperature: npt.ArrayLike | None = None,
    table: Table | None = None,
    start: float = 0.0,
    end: float = math.inf,
    report: AnyPath | None = None,
    kalibr: AnyPath | None = None,
    recording: str = "array",
    progress: Progress = False,
) -> Noise | RateNoise | AxesNoise:
    """The noise of an IMU at rest, as `isotherm noise` shows it: Allan deviation with 95 % intervals, and the coefficients Q, N, B and K.

    `samples` are those of a recording, as an array of RAW_SAMPLE or a data frame with its columns. The longest stretch without a gap, a movement
    or a new session is analysed, between `start` and `end` [s since the begin of the first sample]. With `table` the outputs are compensated, in
    g0 and deg/h; without one they are counts a second. The result is the document of `isotherm noise --json`. `report` (HTML) and `kalibr`
    (imu.yaml, needs a table) are files that are written. `recording` is the name of the samples in messages and files.

    With `interval` [s], `samples` are the rates of one sensor instead, in any unit, that far apart; `temperature` are temperatures of the same
    length, if the part that a straight line in them explains is to be seen. The result is what the document has for one sensor, with "unit" for
    the unit of the rates. All rates are used: nothing looks for gaps or movement. Rates in two dimensions, such as `frame[["ax", "ay", "az"]]`,
    have a column for each axis. The result has one document for each then, in "sensors", with its name or number in "sensor"; `temperature` is
    one of all axes, or has the same columns.

    The result has names too: `noise(samples)["A1"].N` is an `Estimate` with its interval, or None where the curve does not give it; of rates it is
    `noise(rates, interval=0.01).N`. `progress` is a function of (done, total), in rows, or True for a bar of tqdm.

    Raises RecordingFault if the samples are out of order, and NoiseError with fewer than 1000 rows, and with a fault, such as a specific force at rest that is not gravity.

    >>> rates = np.random.default_rng(1).normal(size=2000)
    >>> found = isotherm.noise(rates, interval=0.01)
    >>> [coefficient["name"] for coefficient in found["model"]["coefficients"]]
    ['quantisation noise', 'white noise', 'bias instability', 'random walk of the rate']
    """
    check(interval=interval, start=start, end=end)
    if interval is not None:
        if not (math.isfinite(interval) and interval > 0.0):
            raise ValueError(f"interval is {interval}, give seconds over 0")
        if table is not None or report is not None or kalibr is not None or (start, end) != (0.0, math.inf):
            raise ValueError("table, start, end, report and kalibr are for samples of a recording, not for rates with an interval")
        return noise_of_axes(samples, interval, temperature)
    if temperature is not None:
        raise ValueError("temperature is for rates with an interval; samples have their own")
    if not 0.0 <= start < end:
        raise ValueError(f"start is {start}, end is {end}: give seconds from 0, the start before the end")
    if kalibr is not None and table is None:
        raise ValueError("kalibr needs a table: counts have no unit")
    data = sample_bytes(samples)
    with shown(progress, "noise") as callback:
        text, page, yaml, models = _isotherm.noise(data, table, (start, end), recording, callback)
    if kalibr is not None and yaml is None:
        raise NoiseError(f"{recording}: too many rows are missing for a Kalibr file: see the finding missing-rows; leave out kalibr, or record again")
    write_together([(path, content) for path, content in ((report, page), (kalibr, yaml)) if path is not None and content is not None])
    return Noise(json.loads(text), page, models)


class Calibration:
    """The result of a calibration.

    >>> calibration = isotherm.calibrate_turntable("campaign/campaign.toml")
    >>> calibration.save("table.toml", report="calibration.html")
    >>> isotherm.Table.load("table.toml") == calibration.table
    True
    """

    def __init__(self, native: _isotherm.Calibration) -> None:
        self._native = native

    @property
    def table(self) -> Table:
        """The coefficient table."""
        return self._native.table

    @property
    def text(self) -> str:
        """The text of the sealed table file: the table and its provenance (covariances, set points, misalignments, warnings)."""
        return self._native.text

    @property
    def provenance(self) -> dict[str, Any]:
        """The section `provenance` of the table file."""
        import tomllib

        section = tomllib.loads(self.text)["provenance"]
        assert isinstance(section, dict)
        return section

    @property
    def accuracy(self) -> str:
        """The bottom line: 95 % half widths for whole curves, as in `bias +- 1.20 ug0, scale factor +- 2.1 ppm over 1.2..3.8 V`.

        For a tumble it also states the residuals of its static poses. For a campaign of ramps it states what was measured, and that nothing else was.
        """
        return self._native.accuracy

    @property
    def gyroscope_accuracy(self) -> str | None:
        """The bottom line of the gyroscopes, as "bias +- 0.0071 deg/h, scale factor +- 3.28 ppm over ..."; None without turns."""
        return self._native.gyroscope_accuracy

    @property
    def summary(self) -> dict[str, Any]:
        """The figures: the document of `isotherm calibrate turntable --json`. Keys have their unit at the end; what is not known is None.

        By axis `bias_interval_g0`, `scale_factor_interval_ppm`: the largest 95 % half widths at one temperature (pointwise);
        `bias_band_g0`, `scale_factor_band_ppm`: those that hold for a whole curve at once; `misalignment_rad` with its 95 % half
        widths. Then the orders of the curves, whether the table has or needs an alignment matrix, a `caution` if the set points are few, and the findings. Under
        `gyroscopes`, of a campaign with turns, the same of them, with g-sensitivities, random walk and Earth's rate. Under `transients`, of a
        campaign with ramps, the verdict, the time constant, and each bias with its conditions. Only ramps have that, and `not_known`.
        """
        return self._native.summary

    @property
    def findings(self) -> list[tuple[str, int | None, str]]:
        """Findings of the checks: (severity, line or row, message). A message begins with the name of the finding, as "[soak]: "."""
        return self._native.findings

    @property
    def orders(self) -> dict[str, dict[str, dict[str, Any]]]:
        """The order tables, for example ["A1"]["bias"], as of `regress`. They fit the set points' values, in g0 and pulse/(s*g0).

        Those of gyroscopes ("G1") are in deg/h and pulse/arcsec.
        """
        tables = json.loads(self._native.orders())
        return {sensor: dict(zip(QUANTITIES, table, strict=True)) for sensor, table in zip(SENSORS, tables, strict=False)}

    @property
    def residuals(self) -> npt.NDArray[np.float64]:
        """Residuals by dwell and accelerometer [g0]; one row for each of `dwells`. Those of a tumble have one column: the magnitude of the
        specific force less local gravity."""
        return self._native.residuals()

    @property
    def dwells(self) -> list[tuple[float, int, int, int, float]]:
        """(set point [degC], position, first and last line or row, seconds) of each dwell that was used.

        The dwells of a tumble are its static poses: (mean head temperature in the table's unit, number, first and last row of the recording
        from 0, seconds). Their numbers go on from recording to recording.
        """
        return self._native.dwells()

    def residuals_frame(self) -> pd.DataFrame:
        """The residuals as a data frame: a row for each sensor and each of `dwells` or `gyroscope_runs`, with their columns.

        `unit` is g0 of accelerometers and arcsec of gyroscopes.
        """
        import pandas as pd

        columns = ["set_point_c", "number", "first_row", "last_row", "seconds"]
        parts = []
        for names, unit, places, residuals in (
            (SENSORS[:3], "g0", self.dwells, self.residuals),
            (SENSORS[3:], "arcsec", self.gyroscope_runs, self.gyroscope_residuals),
        ):
            frame = pd.DataFrame(places, columns=columns)
            for index, name in enumerate(names if places else ()):
                parts.append(frame.assign(sensor=name, residual=residuals[:, index], unit=unit))
        whole = pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=[*columns, "sensor", "residual", "unit"])
        return whole[["sensor", *columns, "residual", "unit"]]

    @property
    def curves(self) -> dict[tuple[str, str], Curve]:
        """The curves by sensor and quantity, as curves["A1", "bias"], in the units of the table.

        `at` gives the value with its 95 % interval, by the function that draws the report.
        """
        return by_name(self._native.curves())

    def html(self) -> str:
        """The report as HTML."""
        return self._native.html()

    def _repr_html_(self) -> str:
        return _isotherm.screen(self.html())

    def plot(self, kind: Literal["curves", "residuals", "dwells"] = "curves", *, axes: Any = None) -> Any:
        """Draws the curves with their bands and data, what the data are off them, or the residuals of the dwells. Needs matplotlib.

        Returns the axes: an array with a row for each sensor and a column for each quantity, or one for each sensor.
        """
        from . import _plot

        return _plot.calibration(self, kind, axes)

    @property
    def gyroscope_residuals(self) -> npt.NDArray[np.float64]:
        """Residuals by dwell or turn and gyroscope [arcsec]; one row for each of `gyroscope_runs`."""
        return self._native.gyroscope_residuals()

    @property
    def gyroscope_runs(self) -> list[tuple[float, int, int, int, float]]:
        """(set point [degC], number, first and last line or row, seconds) of each dwell, then of each turn; empty without gyroscopes."""
        return self._native.gyroscope_runs()

    def save(self, path: AnyPath, *, report: AnyPath | None = None) -> None:
        """Writes the sealed table file and, with `report`, the report (HTML). Either both files appear or none."""
        texts = [(path, self.text)]
        if report is not None:
            texts.append((report, self._native.html()))
        write_together(texts)

    def report(self, path: AnyPath) -> None:
        """Writes the report (HTML)."""
        write_text(path, self._native.html())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Calibration) and self._native == other._native

    def __hash__(self) -> int:
        return hash(self._native)

    def __repr__(self) -> str:
        return f"Calibration({self.table!r}, {len(self.dwells)} dwells)"

    def __str__(self) -> str:
        return str(self._native)


def calibrate_turntable(
    campaign: AnyPath | Mapping[str, Any],
    samples: AnyPath | Records | pd.DataFrame | None = None,
    *,
    order: int | Literal["auto"] = "auto",
    method: Literal["one-stage", "two-stage"] = "one-stage",
    alignment: bool | None = None,
    exclude: Iterable[tuple[float, int]] = (),
    accept: Iterable[str] = (),
    strict: bool = False,
    other_device: bool = False,
    lag: float | Literal["none"] | None = None,
    imu: str | None = None,
    start: Moment | None = None,
    end: Moment | None = None,
    progress: Progress = False,
) -> Calibration:
    """Makes a coefficient table from a campaign in the temperature chamber, as `isotherm calibrate turntable` does.

    `campaign` is the path of a campaign file, or a mapping with the same keys. `samples` are its rows: an array of CAMPAIGN, a data
    frame with the columns of a campaign's samples, or the path of a file. Without `samples` the file that the campaign names is
    read. `exclude` lists dwells and turns to leave out: (set point [degC], number). A campaign with turns gives the gyroscopes too.

    The table gets an alignment matrix with `alignment=True`, none with False. With None it gets one if a misalignment exceeds its 99 %
    interval and 1e-6 rad. The matrix turns the axes of the output: a vehicle must keep the choice that it was boresighted with.

    `accept` lists names of findings: a fault of this name is only a warning, and the provenance has the name. With `strict` every
    warning that is not accepted is a fault. Faults raise CalibrationError. Samples of another device than the campaign's serial number says,
    or of two devices, are a fault unless `other_device`.

    The ramps that the campaign names are read too, relative to it (of a mapping: to the current folder). `lag` is the time constant
    of their lag [s] if you know it, "none" for a table without transients; without it the ramps show it, or not. A campaign of ramps has no
    `samples`.

    `imu` is the one to calibrate, of a campaign file with several (`imus`). `start` and `end` leave out what is before and after in each
    recording, as those of `convert`. `progress` is a function of (done, total), in bytes of files or rows of an array, of the reading; the fit comes
    after it. With True a bar of tqdm is drawn.

    >>> calibration = isotherm.calibrate_turntable("campaign/campaign.toml", order=3, exclude=[(-25.0, 3)])
    >>> calibration.table.imu, len(calibration.dwells), calibration.residuals.shape
    ('imu-paper', 179, (179, 3))
    """
    check(imu=imu)
    text, path = campaign_text(campaign)
    given: list[Any] | None
    if samples is None:
        given = None
    elif isinstance(samples, (str, os.PathLike)):
        given = list(paths(samples))
    else:
        given = [as_bytes(rows_of(samples, CAMPAIGN))]
    if lag == 0:
        raise ValueError('lag is 0, give a time constant in s, or "none"')
    options = fit_options(
        order=order,
        method=method,
        alignment=alignment,
        exclude=_pairs(exclude),
        accept=accept,
        strict=strict,
        other_device=other_device,
        lag=0.0 if lag == "none" else lag,
        part=part(start, end),
    )
    with shown(progress, "calibrate") as callback:
        return Calibration(_isotherm.calibrate_campaign(text, path, imu, given, False, options, callback))


def _pairs(exclude: Iterable[tuple[float, int]]) -> list[tuple[float, int]]:
    """The dwells and turns that are left out."""
    try:
        return [(float(set_point), operator.index(number)) for set_point, number in exclude]
    except (TypeError, ValueError):
        raise ValueError(f"exclude is {exclude!r}, give pairs (set point [degC], number) in a list, for example [(-25.0, 3)]") from None


def recorded(recordings: Any) -> list[Path | npt.NDArray[np.uint8]]:
    """One recording or several, each a path, a pattern of paths, or the bytes of its samples."""
    single = is_path(recordings) or is_frame(recordings) or is_arrow(recordings) or hasattr(recordings, "dtype")
    all_of = [recordings] if single else recordings
    return [one for each in all_of for one in (paths(each) if is_path(each) else [sample_bytes(each)])]


def campaign_text(campaign: AnyPath | Mapping[str, Any]) -> tuple[str, Path]:
    """The text of a campaign file and its path; of a mapping one in the current folder."""
    if isinstance(campaign, Mapping):
        return campaign_toml(campaign), Path("campaign")
    return _isotherm.read_text(campaign), Path(campaign)


def fit_options(
    *, order: int | Literal["auto"], accept: Iterable[str], other_device: bool, **given: Any
) -> dict[str, Any]:
    """The options of a fit with those of the command that are not given."""
    if order != "auto" and not (isinstance(order, (int, np.integer)) and not isinstance(order, bool) and 0 <= order <= 7):
        raise ValueError(f'order is {order!r}, give "auto" or a whole number from 0 to 7')
    names = texts("accept", accept)
    check(other_device=other_device, **{name: value for name, value in given.items() if name in KINDS})
    options: dict[str, Any] = {
        "order": None if order == "auto" else order,
        "method": "one-stage",
        "alignment": None,
        "exclude": [],
        "accept": [*names, "other-device"] if other_device else names,
        "lag": None,
        "window": None,
        "scale_factor": "auto",
        "misalignment": True,
        "static_poses": [],
        "temperature_range": None,
        "place": None,
        "foreign": (None, None, None, (None, None, None, None, "header"), None),
        "part": (None, None),
        "at": None,
        "beside": [],
    }
    return options | given


def compare(*tables: Table | Calibration | AnyPath, other_device: bool = False) -> Comparison:
    """Compares tables of one IMU, as `isotherm compare` does: the old one and the new one, or three or more by their dates.

    A table is a path, a Table, or the Calibration that made it. Their errors and dates come from the provenance. With `other_device` the tables may be
    of different IMUs. Raises ComparisonError if they cannot be compared.

    >>> isotherm.compare("imu-a.toml", "imu-b.toml", other_device=True).changed
    []
    """
    return _isotherm.compare(_named(tables), other_device)


def batch(tables: Iterable[Table | Calibration | AnyPath]) -> Batch:
    """The statistics of tables of different IMUs of one kind: how they spread, which IMU stands out, and whether one curve fits all.

    A table is a path, a Table, or the Calibration that made it. Raises ComparisonError if there are fewer than two, if two are of one IMU, or if their
    temperature is in different units.

    >>> isotherm.batch(["imu-a.toml", "imu-b.toml"]).stand_outs is None  # under five devices
    True
    """
    return _isotherm.batch(_named(tables))


def _named(tables: Iterable[Table | Calibration | AnyPath]) -> list[tuple[str, Table]]:
    """The tables, each with its name in messages."""

    def named(index: int, table: Table | Calibration | AnyPath) -> tuple[str, Table]:
        if isinstance(table, Calibration):
            table = table.table
        if isinstance(table, Table):
            return f"table {index}", table
        return os.fspath(table), Table.load(table)

    return [named(index, table) for index, table in enumerate(tables, 1)]


def campaign_toml(campaign: Mapping[str, Any]) -> str:
    """A campaign's settings as the text of a campaign file."""
    alone = campaign.get("ramp") and not campaign.get("position")
    plain = ({} if alone else {"samples": "samples"}) | {key: value for key, value in campaign.items() if key not in LISTS and value is not None}
    lines = [f"{json.dumps(key)} = {toml_value(value)}" for key, value in plain.items()]
    for name in LISTS:
        for section in campaign.get(name) or ():
            lines += ["", f"[[{name}]]"]
            lines += [f"{json.dumps(key)} = {toml_value(value)}" for key, value in section.items() if value is not None]
    return "\n".join(lines) + "\n"
