"""What can go wrong. Every exception of this package's own is an IsothermError."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ._isotherm import Loan
    from ._records import Records


class IsothermError(Exception):
    """Base of all; raised itself where no other says more."""


class NoService(IsothermError):
    """No service is running in the domain."""


class NoSuchImu(NoService):
    """The service runs, but not for this IMU."""


class Occupied(IsothermError):
    """The IMU has an acquisition process already, or no place for another reader."""


class TransportError(IsothermError):
    """The transport failed."""


class Full(IsothermError):
    """As many samples as the service's queue holds are unanswered.

    `sample` is what was to be sent, and can be sent later or be merged into.
    """

    def __init__(self, message: str, sample: Loan | Any) -> None:
        super().__init__(message)
        self.sample = sample


class Timeout(IsothermError, TimeoutError):
    """No answer in time. The sample stays in flight: a later `receive` may still get its answer.

    `increments` are those that `Acquisition.run` had received until then, else None.
    """

    def __init__(self, message: str, increments: Records | None = None) -> None:
        super().__init__(message)
        self.increments = increments


class SequenceError(IsothermError, ValueError):
    """The sequence does not rise above the last one sent in this session."""


class Closed(IsothermError, ValueError):
    """The acquisition or reader is closed, or the loaned sample has been sent."""


class WrongThread(IsothermError, RuntimeError):
    """Used in another thread or process than the one that opened it."""


class TableError(IsothermError, ValueError):
    """A table or campaign file is not valid. `faults` are (line, key, message), all of the file."""

    def __init__(self, message: str, faults: list[tuple[int, str, str]]) -> None:
        super().__init__(message)
        self.faults = faults


class RecordingFault(IsothermError, ValueError):
    """A recording cannot be read. `line` is that of the file, from 1; of an array, the row from 0."""

    def __init__(self, message: str, line: int) -> None:
        super().__init__(message)
        self.line = line


class CalibrationError(IsothermError, ValueError):
    """A campaign does not become a table. `findings` are (severity, line, message) of the checks."""

    def __init__(self, message: str, findings: list[tuple[str, int | None, str]] | None = None) -> None:
        super().__init__(message)
        self.findings = findings or []


class StabilityError(IsothermError, ValueError):
    """A recording shows no stability: too short, not still, or no number."""
