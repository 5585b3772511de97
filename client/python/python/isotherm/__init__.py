"""Isotherm: clients of the compensation service and its offline tools. See docs/python.md of the repository."""

import os

from ._errors import (
    CalibrationError,
    Closed,
    Full,
    IsothermError,
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
from ._isotherm import Acquisition, Axis, Increment, IncrementReader, Loan, Polynomial, Stability, Table, __version__, count_fork
from ._offline import (
    Calibration,
    calibrate,
    read_increments,
    read_recording,
    regress,
    replay,
    verify,
    write_increments,
    write_recording,
)
from ._records import CAMPAIGN, INCREMENT, RAW_SAMPLE, WINDOW, Flags, Records, flag_names

# A forked child must not use its parent's streams.
os.register_at_fork(after_in_child=count_fork)
del os, count_fork

__all__ = [
    "CAMPAIGN",
    "INCREMENT",
    "RAW_SAMPLE",
    "WINDOW",
    "Acquisition",
    "Axis",
    "Calibration",
    "CalibrationError",
    "Closed",
    "Flags",
    "Full",
    "Increment",
    "IncrementReader",
    "IsothermError",
    "Loan",
    "NoService",
    "NoSuchImu",
    "Occupied",
    "Polynomial",
    "RecordingFault",
    "Records",
    "SequenceError",
    "Stability",
    "StabilityError",
    "Table",
    "TableError",
    "Timeout",
    "TransportError",
    "WrongThread",
    "__version__",
    "calibrate",
    "flag_names",
    "read_increments",
    "read_recording",
    "regress",
    "replay",
    "verify",
    "write_increments",
    "write_recording",
]
