"""Curves over temperature, whose values have their intervals."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, overload

import numpy as np
import numpy.typing as npt

from ._records import flat_doubles

if TYPE_CHECKING:
    from . import _isotherm

Doubles = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval.

    `interval` is None where it is not known. `below` is the end of the range if that includes 0: then only this is known of the size.

    >>> found = isotherm.calibrate_turntable("campaign/campaign.toml").curves["A1", "bias"].at(2.5)
    >>> found.unit, float(found) == found.value
    ('ug0', True)
    """

    value: float
    interval: tuple[float, float] | None
    unit: str
    below: float | None

    def __float__(self) -> float:
        return self.value

    def __str__(self) -> str:
        if self.below is not None:
            return f"below {self.below:.4g} {self.unit}"
        range_ = "" if self.interval is None else f" (95 %: {self.interval[0]:.6g} to {self.interval[1]:.6g})"
        return f"{self.value:.6g} {self.unit}{range_}"


@dataclass(frozen=True, eq=False)
class Estimates:
    """Values with their 95 % intervals, as arrays. The ends are NaN where they are not known.

    >>> found = isotherm.calibrate_turntable("campaign/campaign.toml").curves["A1", "bias"].at(np.array([2.0, 3.0]))
    >>> bool((found.low < found.value).all()), found.high.shape
    (True, (2,))
    """

    value: Doubles
    low: Doubles
    high: Doubles
    unit: str


class Curve:
    """One curve: bias, positive or negative scale factor of a sensor over head or board temperature.

    >>> curve = isotherm.calibrate_turntable("campaign/campaign.toml").curves["A1", "bias"]
    >>> found = curve.at(2.5)
    >>> curve.unit, found.interval[0] < found.value < found.interval[1]
    ('ug0', True)
    """

    def __init__(self, native: _isotherm.Curve) -> None:
        self._native = native

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Curve) and self._native == other._native

    def __hash__(self) -> int:
        return hash(self._native)

    @property
    def sensor(self) -> str:
        """A1 to G3."""
        return self._native.sensor

    @property
    def quantity(self) -> str:
        """bias, positive_scale_factor or negative_scale_factor."""
        return self._native.quantity

    @property
    def unit(self) -> str:
        """The unit of the values."""
        return self._native.unit

    @property
    def temperature_unit(self) -> str:
        """The unit of the temperature."""
        return self._native.temperature_unit

    @property
    def range(self) -> tuple[float, float]:
        """Lower and upper end of the calibrated temperature."""
        return self._native.range

    @property
    def order(self) -> int:
        """Order of the polynomial."""
        return self._native.order

    @property
    def points(self) -> Doubles:
        """The data that the report draws: temperature, value, and half length of the 95 % error bar (NaN if it is not known), a row each.

        They are the set points of a campaign or the means of a warm-up; no row for a tumble, and for a table that was read from a file.
        """
        return np.array(self._native.points, dtype=np.float64).reshape(-1, 3)

    @overload
    def at(self, temperature: float) -> Estimate: ...
    @overload
    def at(self, temperature: npt.NDArray[Any]) -> Estimates: ...
    def at(self, temperature: float | npt.NDArray[Any]) -> Estimate | Estimates:
        """The value at a temperature, or at each of an array, with the 95 % interval that holds there by itself.

        Of a warm-up the interval is the band between its sweeps, as in the report.
        """
        return self._estimate(temperature, False)

    @overload
    def band(self, temperature: float) -> Estimate: ...
    @overload
    def band(self, temperature: npt.NDArray[Any]) -> Estimates: ...
    def band(self, temperature: float | npt.NDArray[Any]) -> Estimate | Estimates:
        """The same with the band that holds for the whole curve at once with 95 %: the one that the report draws."""
        return self._estimate(temperature, True)

    def _estimate(self, temperature: float | npt.NDArray[Any], whole: bool) -> Estimate | Estimates:
        shape = np.shape(temperature)
        value, half = (each.reshape(shape) for each in self._native.evaluate(flat_doubles(temperature), whole))
        if shape:
            return Estimates(value, value - half, value + half, self.unit)
        interval = None if np.isnan(half) else (float(value - half), float(value + half))
        return Estimate(float(value), interval, self.unit, None)

    def __repr__(self) -> str:
        low, high = self.range
        return f"Curve({self.sensor} {self.quantity}, order {self.order}, {low:g} to {high:g} {self.temperature_unit}, {self.unit})"


def by_name(natives: Iterable[_isotherm.Curve]) -> dict[tuple[str, str], Curve]:
    """The curves by sensor and quantity."""
    return {(native.sensor, native.quantity): Curve(native) for native in natives}
