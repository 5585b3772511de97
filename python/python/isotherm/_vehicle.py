"""Calibration of all IMUs of an autopilot's logs: a table each, and one file of parameters for the vehicle."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Literal

from . import _isotherm
from ._isotherm import Exported, Table
from ._offline import Calibration
from ._paths import AnyPath, paths
from ._progress import Progress, shown
from ._times import Moment
from ._warm_up import warm_up_options


class Vehicle(dict[int, Calibration]):
    """The calibrations of the IMUs of a vehicle, by their numbers in the logs.

    `refused` has the exceptions of the IMUs that have none.

    >>> vehicle = isotherm.calibrate_vehicle("warm-up.BIN", "imu-c", lag="none")
    >>> vehicle.export("ardupilot").lost
    []
    """

    def __init__(self, imu: str, made: Iterable[tuple[int, _isotherm.Calibration | None, Exception | None]]) -> None:
        every = list(made)
        super().__init__({instance: Calibration(native) for instance, native, _ in every if native is not None})
        self.refused: dict[int, Exception] = {instance: error for instance, _, error in every if error is not None}
        self._imu = imu

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Vehicle) and dict.__eq__(self, other) and vars(self) == vars(other)

    def _repr_html_(self) -> str:
        refused = (f"<p>IMU {number}: {escape(str(error))}</p>" for number, error in sorted(self.refused.items()))
        return "".join([*(made._repr_html_() for _, made in sorted(self.items())), *refused])

    def export(self, to: Literal["px4", "ardupilot"], *, at: float | None = None, drop: Sequence[str] = ()) -> Exported:
        """The parameters of all IMUs as one file, each as `export_parameters` gives them. What enables all sensors of a kind at once, as PX4's
        TC_A_ENABLE, is only in it if every IMU has parameters; otherwise the notes name those that have none.
        """
        numbers = sorted([*self, *self.refused])
        imus = [(f"{self._imu}-{number}", self[number].table if number in self else None) for number in numbers]
        return _isotherm.export_vehicle(imus, to, at, list(drop))


def calibrate_vehicle(
    logs: AnyPath | Sequence[AnyPath],
    imu: str,
    *,
    nominal: Mapping[int, Table] | None = None,
    order: int | Literal["auto"] = "auto",
    lag: float | Literal["none"] | None = None,
    at: float | None = None,
    gravity_reference: float | None = None,
    beside: Iterable[Literal["px4", "ardupilot"]] = (),
    accept: Iterable[str] = (),
    strict: bool = False,
    other_device: bool = False,
    temperature: float | None = None,
    interval: float | None = None,
    start: Moment | None = None,
    end: Moment | None = None,
    progress: Progress = False,
) -> Vehicle:
    """Makes bias curves of all IMUs of an autopilot's logs, as `isotherm calibrate warm-up` does.

    `logs` is a ULog or DataFlash log, or several. If logs have several IMUs, the tables are for `imu`-0, `imu`-1 and so on, by the numbers in the
    logs; for logs with one IMU it is for `imu`. An IMU whose rows give no table is in `Vehicle.refused`, with the exception, and the others continue. `nominal` are tables by those numbers.
    Everything else is as in `calibrate_warm_up`, which makes the table of one IMU: with `instance` of the one that it names. `progress` is as that of `calibrate_turntable`.

    >>> vehicle = isotherm.calibrate_vehicle("warm-up.BIN", "imu-c", lag="none")
    >>> [calibration.table.imu for calibration in vehicle.values()], vehicle.refused
    (['imu-c'], {})
    """
    options = warm_up_options(
        order, lag, at, gravity_reference, beside, accept, strict, other_device, (None, temperature, interval, None, None, None, None, "header", None), (start, end)
    )
    with shown(progress, "calibrate") as callback:
        return Vehicle(imu, _isotherm.calibrate_vehicle(paths(logs), imu, dict(nominal or {}), gravity_reference, options, callback))
