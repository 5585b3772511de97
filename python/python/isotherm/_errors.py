"""Exceptions of this package. Each is an IsothermError."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ._isotherm import Loan
    from ._records import Records


class IsothermError(Exception):
    """Base class of all; raised itself if no subclass is more specific."""


class NoService(IsothermError):
    """No service is running in the domain."""


class NoSuchImu(NoService):
    """The service runs, but not for this IMU."""


class Occupied(IsothermError):
    """The IMU has an acquisition process already, or no place for another reader."""


class TransportError(IsothermError):
    """The transport failed."""


class Full(IsothermError):
    """As many samples are unanswered as the service's queue holds, or others are kept, which go first.

    `sample` was not sent. `Acquisition.keep` it, or send it later.
    """

    def __init__(self, message: str, sample: Loan | Any) -> None:
        super().__init__(message)
        self.sample = sample


class Timeout(IsothermError, TimeoutError):
    """No answer in time. The sample stays in flight: a later `receive` may still return its answer.

    `increments` are those that `Acquisition.run` has received before; None for other calls.
    """

    def __init__(self, message: str, increments: Records | None = None) -> None:
        super().__init__(message)
        self.increments = increments


class SequenceError(IsothermError, ValueError):
    """The sequence does not rise above the last one sent in this session."""


class Closed(IsothermError, ValueError):
    """The acquisition or reader is closed, or the loaned sample has been sent."""


class WrongThread(IsothermError, RuntimeError):
    """An acquisition or reader was used in a thread or process that did not create it."""


class TableError(IsothermError, ValueError):
    """A table, campaign or mapping file is not valid. `faults` are all faults of the file: (line, key, message)."""

    def __init__(self, message: str, faults: list[tuple[int, str, str]]) -> None:
        super().__init__(message)
        self.faults = faults


class RecordingFault(IsothermError, ValueError):
    """A recording cannot be read. `line` is the line of the file, from 1; for an array it is the row, from 0."""

    def __init__(self, message: str, line: int) -> None:
        super().__init__(message)
        self.line = line


class CalibrationError(IsothermError, ValueError):
    """No table can be made from a campaign. `findings` are (severity, line, message) of the checks, see `Calibration.findings`.

    The first is the mistake that explains the others, if there is one. The message then only counts those that it explains.
    """

    def __init__(self, message: str, findings: list[tuple[str, int | None, str]] | None = None) -> None:
        super().__init__(message)
        self.findings = findings or []


class ComparisonError(IsothermError, ValueError):
    """Tables cannot be compared, or make no batch. `Comparison.check` raises it too: they differ by more than is required."""


class NoiseError(IsothermError, ValueError):
    """The noise cannot be computed: fewer than 1000 rows at rest without a gap, rates that never change or that are not finite."""


class StabilityError(IsothermError, ValueError):
    """The stability cannot be computed from a recording: it is too short, not still, or has values that are not finite.

    `Stability.check` raises it too: what is required is not met, or the output is not as long as gravity.
    """
