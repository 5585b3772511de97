"""Figures of results with matplotlib, which is an extra: pip install 'isotherm[plot]'. Each function returns its axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ._curves import Curve

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ._documents import Lengths, SensorNoise
    from ._isotherm import Batch, Comparison, Stability, Table
    from ._offline import Calibration

SHORT = {"bias": "bias", "positive_scale_factor": "K+", "negative_scale_factor": "K-"}


def grid(rows: int, columns: int, axes: Any, width: float = 4.0) -> Any:
    """Axes for so many figures, as a flat array: those that are given, or new ones."""
    try:
        from matplotlib import pyplot
    except ImportError as error:
        raise ImportError("plot() needs matplotlib: pip install matplotlib, or pip install 'isotherm[plot]'") from error
    if axes is None:
        size = (width * columns, 2.8 * rows)
        _, axes = pyplot.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False)
    flat = np.atleast_1d(np.asarray(axes, dtype=object)).ravel()
    if len(flat) != rows * columns:
        raise ValueError(f"{len(flat)} axes are given, {rows * columns} are needed")
    return flat


def curve_axes(ax: Axes, curve: Curve, residuals: bool) -> None:
    """Draws a curve with its band and its data, or what the data are off it."""
    low, high = curve.range
    at = np.linspace(low, high, 121)
    band = curve.band(at)
    taken = band.value if residuals else 0.0
    ax.plot(at, band.value - taken, label="table")
    ax.fill_between(at, band.low - taken, band.high - taken, alpha=0.25, label="95 %, whole curve")
    points = curve.points
    if len(points):
        values = points[:, 1] - (curve.at(points[:, 0]).value if residuals else 0.0)
        bars = np.nan_to_num(points[:, 2])
        ax.errorbar(points[:, 0], values, bars, fmt=".", label="data, 95 %")
    ax.set_xlabel(f"temperature / {curve.temperature_unit}")
    ax.set_ylabel(f"{SHORT[curve.quantity]}{' residual' if residuals else ''} / ({curve.unit})")
    ax.set_title(f"{SHORT[curve.quantity]} of {curve.sensor}")


def curves(found: Mapping[tuple[str, str], Curve], residuals: bool, axes: Any) -> Any:
    """A row for each sensor, a column for each quantity."""
    sensors = list(dict.fromkeys(sensor for sensor, _ in found))
    flat = grid(len(sensors), len(SHORT), axes)
    for ax, curve in zip(flat, (found[sensor, quantity] for sensor in sensors for quantity in SHORT), strict=True):
        curve_axes(ax, curve, residuals)
    flat[0].legend(fontsize="small")
    return flat.reshape(len(sensors), len(SHORT))


def table(of: Table, *, axes: Any = None) -> Any:
    return curves(of.curves, False, axes)


def calibration(of: Calibration, kind: Literal["curves", "residuals", "dwells"], axes: Any) -> Any:
    if kind != "dwells":
        if kind not in ("curves", "residuals"):
            raise ValueError(f'kind is {kind!r}, give "curves", "residuals" or "dwells"')
        return curves(of.curves, kind == "residuals", axes)
    residuals = of.residuals_frame()
    sensors = list(dict.fromkeys(residuals["sensor"]))
    flat = grid(1, len(sensors), axes)
    for ax, sensor in zip(flat, sensors, strict=True):
        own = residuals[residuals["sensor"] == sensor]
        ax.plot(own["set_point_c"], own["residual"], ".")
        ax.axhline(0.0, linewidth=0.8, color="gray")
        ax.set_title(f"residuals of {sensor}")
        ax.set_xlabel("set point / degC")
        ax.set_ylabel(f"residual / ({own['unit'].iloc[0]})" if len(own) else "residual")
    return flat


def stability(of: Stability, *, axes: Any = None) -> Any:
    """Before and after compensation over time, for each axis."""
    flat = grid(3, 1, axes, 7.0)
    windows = of.windows
    counted = windows[windows["counts"]]
    for index, ax in enumerate(flat):
        for name in ("before", "after"):
            error = (counted[name][:, index] - of.specific_force[index]) * 1e6
            ax.plot(counted["time_s"] / 3600.0, error, ".", markersize=3, label=name)
        ax.axhline(0.0, linewidth=0.8, color="gray")
        ax.set_ylabel(f"A{index + 1} error / (ug0)")
    flat[0].legend(fontsize="small")
    flat[-1].set_xlabel("time / h")
    return flat


def noise(sensors: Mapping[str, SensorNoise], *, axes: Any = None) -> Any:
    """Allan deviations with 95 % intervals and the model."""
    found = {name: sensor for name, sensor in sensors.items() if sensor.document.get("tau_s")}
    columns = min(3, max(1, len(found)))
    flat = grid(-(-len(found) // columns) or 1, columns, axes)
    for ax, (name, sensor) in zip(flat, found.items(), strict=False):
        document = sensor.document
        tau, deviation = np.array(document["tau_s"]), np.array(document["adev_in_unit"])
        ends = np.array([[np.nan, np.nan] if each is None else each for each in document["interval_in_unit"]]).reshape(-1, 2)
        ax.loglog(tau, deviation, ".-", label="measured")
        ax.fill_between(tau, ends[:, 0], ends[:, 1], alpha=0.25, label="95 %")
        if sensor.model:
            ax.loglog(tau, sensor.model, "--", label="model")
        ax.set_title(name)
        ax.set_xlabel("tau / s")
        ax.set_ylabel(f"Allan deviation / ({document['unit']})")
    flat[0].legend(fontsize="small")
    return flat


def comparison(of: Comparison, *, axes: Any = None) -> Any:
    """The difference of each curve, new less old, with its band."""
    found: Sequence[Any] = of.summary["curves"]
    flat = grid(-(-len(found) // 3) or 1, min(3, max(1, len(found))), axes)
    for ax, curve in zip(flat, found, strict=False):
        at, difference = np.array(curve["temperature"]["points_in_unit"]), np.array(curve["differences_in_unit"])
        ax.plot(at, difference, label="new less old")
        if curve["half_widths_in_unit"] is not None:
            half = np.array(curve["half_widths_in_unit"])
            ax.fill_between(at, difference - half, difference + half, alpha=0.25, label="95 %")
        ax.axhline(0.0, linewidth=0.8, color="gray")
        ax.set_title(f"{SHORT.get(curve['quantity'], curve['quantity'])} of {curve['sensor']}")
        ax.set_xlabel(f"temperature / {curve['temperature']['unit']}")
        ax.set_ylabel(f"difference / ({curve['unit']})")
    flat[0].legend(fontsize="small")
    return flat


def batch(of: Batch, *, ax: Axes | None = None) -> Axes:
    """How far each device is from the others, by quantity, and from where on it stands out."""
    summary = of.summary
    (place,) = grid(1, 1, ax, 8.0)
    for device, name in enumerate(summary["devices"]):
        sizes = [np.nan if quantity["t"][device] is None else quantity["t"][device] for quantity in summary["quantities"]]
        place.plot(range(len(sizes)), sizes, ".", label=name)
    if summary["limit_t"] is not None:
        for limit in (-summary["limit_t"], summary["limit_t"]):
            place.axhline(limit, linewidth=0.8, color="gray")
    place.set_xticks(range(len(summary["quantities"])), [quantity["name"] for quantity in summary["quantities"]], rotation=90, fontsize="small")
    place.set_ylabel("t")
    if len(summary["devices"]) <= 10:
        place.legend(fontsize="small")
    return place  # type: ignore[no-any-return]


def lengths(of: Lengths, *, ax: Axes | None = None) -> Axes:
    (place,) = grid(1, 1, ax, 6.0)
    poses = of["static_pose"]
    numbers = [pose["number"] for pose in poses]
    place.errorbar(numbers, [pose["error_g0"] * 1e6 for pose in poses], [pose["interval_g0"] * 1e6 for pose in poses], fmt=".")
    place.axhline(0.0, linewidth=0.8, color="gray")
    place.set_xlabel("static pose")
    place.set_ylabel("length less gravity / (ug0)")
    return place  # type: ignore[no-any-return]
