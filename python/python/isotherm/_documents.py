"""Results that are documents: dictionaries with the report and names for what is looked up most."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any

from ._curves import Estimate
from ._files import write_text
from ._isotherm import screen
from ._paths import AnyPath

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Document(dict[str, Any]):
    """A document as the command prints it with `--json`, and its report."""

    def __init__(self, document: dict[str, Any], html: str) -> None:
        super().__init__(document)
        self._html = html

    def html(self) -> str:
        """The report as HTML."""
        return self._html

    def report(self, path: AnyPath) -> None:
        """Writes the report (HTML)."""
        write_text(path, self._html)

    def _repr_html_(self) -> str:
        return screen(self._html)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (dict(self), self._html)


class Lengths(Document):
    """The lengths of gravity over static poses: the document of `isotherm verify --static-poses --json`.

    >>> facts = {"imu": "imu-x", "gravity_local": 9.81, "gravity_reference": 9.81, "temperature_unit": "degC"}
    >>> table = isotherm.calibrate_tumble(facts, "tumble.csv", temperature_range=(0.0, 50.0)).table
    >>> len(isotherm.lengths(table, isotherm.read_recording("tumble.csv"), gravity_local=9.81)["static_pose"])
    40
    """

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """Draws the error of each static pose with its interval. Needs matplotlib."""
        from . import _plot

        return _plot.lengths(self, ax=ax)


class SensorNoise:
    """The noise of one sensor: the part of the document, and its coefficients with their 95 % intervals.

    >>> found = isotherm.noise(isotherm.read_recording("still.csv"))["A1"]
    >>> found.document["axis"]
    'A1'
    """

    def __init__(self, document: dict[str, Any], model: list[float]) -> None:
        self.document = document
        # The Allan deviations of the model at `tau_s`; empty without a model.
        self.model = model

    def _coefficient(self, letter: str) -> Estimate | None:
        model = self.document.get("model")
        for found in model["coefficients"] if model else ():
            if found["letter"] == letter and "value_in_unit" in found:
                range_ = found["range_in_unit"]
                return Estimate(found["value_in_unit"], None if range_ is None else (range_[0], range_[1]), found["unit"], found["below_in_unit"])
        return None

    @property
    def Q(self) -> Estimate | None:  # noqa: N802
        """Quantisation noise; None where the curve does not give it."""
        return self._coefficient("Q")

    @property
    def N(self) -> Estimate | None:  # noqa: N802
        """White noise: velocity or angle random walk; None where the curve does not give it."""
        return self._coefficient("N")

    @property
    def B(self) -> Estimate | None:  # noqa: N802
        """Bias instability; None where the curve does not give it."""
        return self._coefficient("B")

    @property
    def K(self) -> Estimate | None:  # noqa: N802
        """Random walk of the rate; None where the curve does not give it."""
        return self._coefficient("K")

    def __repr__(self) -> str:
        return f"SensorNoise({', '.join(f'{letter}={getattr(self, letter)}' for letter in 'QNBK')})"


class Noise(Document):
    """The noise of a recording: the document of `isotherm noise --json`. `noise["A1"]` is the noise of a sensor, as `noise["A1"].N`.

    >>> found = isotherm.noise(isotherm.read_recording("still.csv"))
    >>> list(found.by_sensor)
    ['A1', 'A2', 'A3']
    """

    def __init__(self, document: dict[str, Any], html: str, models: list[list[float]]) -> None:
        super().__init__(document, html)
        self._models = models

    @property
    def by_sensor(self) -> dict[str, SensorNoise]:
        """The noise of each sensor."""
        return {found["axis"]: SensorNoise(found, model) for found, model in zip(self["sensors"], self._models, strict=True)}

    def __missing__(self, name: str) -> SensorNoise:
        return self.by_sensor[name]

    def plot(self, *, axes: Any = None) -> Any:
        """Draws the Allan deviations of each sensor with their intervals and the model. Needs matplotlib; returns the axes."""
        from . import _plot

        return _plot.noise(self.by_sensor, axes=axes)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (dict(self), self._html, self._models)


class RateNoise(Document, SensorNoise):
    """The noise of rates at one interval, in their unit: what the document of a recording has for a sensor, with `N` and the others.

    >>> found = isotherm.noise(np.random.default_rng(1).normal(size=2000), interval=0.01)
    >>> low, high = found.N.interval
    >>> low < 0.1 < high
    True
    """

    def __init__(self, document: dict[str, Any], html: str, model: list[float]) -> None:
        Document.__init__(self, document, html)
        SensorNoise.__init__(self, self, model)

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """Draws the Allan deviations with their intervals and the model. Needs matplotlib."""
        from . import _plot

        return _plot.noise({"Rates": self}, axes=ax)[0]  # type: ignore[no-any-return]

    def __repr__(self) -> str:
        return dict.__repr__(self)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (dict(self), self._html, self.model)


class AxesNoise(dict[str, Any]):
    """The noise of rates in columns: one document for each in "sensors". `found["ax"]` is the `RateNoise` of a column, as `found["ax"].N`.

    >>> found = isotherm.noise(np.random.default_rng(1).normal(size=(2000, 3)), interval=0.01)
    >>> list(found.by_sensor), found["2"].N.unit
    (['0', '1', '2'], 'unit/sqrt(Hz)')
    """

    def __init__(self, by_sensor: dict[str, RateNoise]) -> None:
        super().__init__(sensors=[{"sensor": name} | {key: value for key, value in one.items() if key != "sensor"} for name, one in by_sensor.items()])
        self.by_sensor = by_sensor

    def __missing__(self, name: str) -> RateNoise:
        return self.by_sensor[name]

    def plot(self, *, axes: Any = None) -> Any:
        """Draws the Allan deviations of each column with their intervals and the model. Needs matplotlib; returns the axes."""
        from . import _plot

        return _plot.noise(self.by_sensor, axes=axes)

    def _repr_html_(self) -> str:
        return "".join(f"<p>{escape(name)}</p>{one._repr_html_()}" for name, one in self.by_sensor.items())

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.by_sensor,)
