"""Isotherm: clients of the compensation service and its offline tools. See docs/python.md of the repository."""

from ._convert import convert, write_ros
from ._curves import Curve, Estimate, Estimates
from ._documents import AxesNoise, Lengths, Noise, RateNoise, SensorNoise
from ._errors import (
    CalibrationError,
    Closed,
    ComparisonError,
    Full,
    IsothermError,
    NoiseError,
    NoService,
    NoSuchImu,
    Occupied,
    RecordingFault,
    SequenceError,
    StabilityError,
    TableError,
    Timeout,
    TransportError,
    WrongThread,
)
from ._frames import from_arrow, from_frame, to_arrow, to_frame
from ._isotherm import (
    Acquisition,
    Axis,
    Batch,
    Comparison,
    Exported,
    Increment,
    IncrementReader,
    Loan,
    Polynomial,
    Stability,
    Table,
    Triad,
    __version__,
    device,
    export_parameters,
    import_parameters,
)
from ._offline import (
    Calibration,
    batch,
    calibrate_turntable,
    compare,
    noise,
    read_increments,
    read_recording,
    regress,
    repair,
    replay,
    verify,
    write_increments,
    write_recording,
)
from ._records import CAMPAIGN, INCREMENT, RAW_SAMPLE, TRIAD, WINDOW, Flags, Records, flag_names
from ._tumble import calibrate_tumble, lengths
from ._vehicle import Vehicle, calibrate_vehicle
from ._warm_up import calibrate_warm_up

__all__ = [
    "CAMPAIGN",
    "INCREMENT",
    "RAW_SAMPLE",
    "TRIAD",
    "WINDOW",
    "Acquisition",
    "AxesNoise",
    "Axis",
    "Batch",
    "Calibration",
    "CalibrationError",
    "Closed",
    "Comparison",
    "ComparisonError",
    "Curve",
    "Estimate",
    "Estimates",
    "Exported",
    "Flags",
    "Full",
    "Increment",
    "IncrementReader",
    "IsothermError",
    "Lengths",
    "Loan",
    "NoService",
    "NoSuchImu",
    "Noise",
    "NoiseError",
    "Occupied",
    "Polynomial",
    "RateNoise",
    "RecordingFault",
    "Records",
    "SensorNoise",
    "SequenceError",
    "Stability",
    "StabilityError",
    "Table",
    "TableError",
    "Timeout",
    "TransportError",
    "Triad",
    "Vehicle",
    "WrongThread",
    "__version__",
    "batch",
    "calibrate_tumble",
    "calibrate_turntable",
    "calibrate_vehicle",
    "calibrate_warm_up",
    "compare",
    "convert",
    "device",
    "export_parameters",
    "flag_names",
    "from_arrow",
    "from_frame",
    "import_parameters",
    "lengths",
    "noise",
    "read_increments",
    "read_recording",
    "regress",
    "repair",
    "replay",
    "to_arrow",
    "to_frame",
    "verify",
    "write_increments",
    "write_recording",
    "write_ros",
]

_NEW_NAMES = {
    "calibrate": "calibrate_turntable",
    "calibrate_gravity_only": "calibrate_tumble",
    "calibrate_one_attitude": "calibrate_warm_up",
}


def __getattr__(name: str) -> object:
    """Names the function that took the place of a former one."""
    if new := _NEW_NAMES.get(name):
        raise AttributeError(f"isotherm.{name} is isotherm.{new} now")
    raise AttributeError(f"module 'isotherm' has no attribute {name!r}")
