"""The noise of rates: those of one axis, or a column for each of several."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _isotherm
from ._columns import columns_of
from ._documents import AxesNoise, RateNoise
from ._errors import NoiseError
from ._records import doubles


def noise_of_axes(rates: Any, interval: float, temperature: Any) -> RateNoise | AxesNoise:
    """The noise of the rates of one axis; of rates in two dimensions that of each column."""
    axes = _axes("rates", rates)
    if axes is None:
        return _noise_of("", doubles("rates", rates), interval, None if temperature is None else doubles("temperature", temperature))
    heads = None if temperature is None else _axes("temperature", temperature)
    if heads is not None and len(heads) != len(axes):
        raise ValueError(f"temperature has {len(heads)} columns and rates have {len(axes)}; give one temperature of all, or one for each")
    common = None if temperature is None or heads is not None else doubles("temperature", temperature)
    of_axis = [heads[index][1] if heads is not None else common for index in range(len(axes))]
    return AxesNoise({name: _noise_of(f"{name}: ", values, interval, head) for (name, values), head in zip(axes, of_axis, strict=True)})


def _noise_of(place: str, rates: npt.NDArray[np.float64], interval: float, temperature: npt.NDArray[np.float64] | None) -> RateNoise:
    if temperature is not None and len(temperature) != len(rates):
        raise ValueError("rates and temperature must be of one length")
    try:
        document, report, model = _isotherm.noise_of_rates(rates, interval, temperature)
    except NoiseError as error:
        if not place:
            raise
        raise NoiseError(f"{place}{error}") from None
    return RateNoise(json.loads(document), report, model)


def _axes(what: str, values: Any) -> list[tuple[str, npt.NDArray[np.float64]]] | None:
    """The columns of numbers in two dimensions, with their names or their numbers from 0; None of numbers in one dimension."""
    if (columns := columns_of(values)) is not None:
        return [(name, doubles(f"{what}: {name}", columns.values(name))) for name in columns.names]
    if np.ndim(values) != 2:
        return None
    array = np.asarray(values, dtype=np.float64)
    rows, axes = array.shape
    if axes > rows:
        raise ValueError(f"{what} has the shape {array.shape}, give a column for each axis: the transposed array")
    return [(str(axis), np.ascontiguousarray(array[:, axis])) for axis in range(axes)]
