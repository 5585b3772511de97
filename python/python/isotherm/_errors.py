"""Exceptions of this package. Each is an IsothermError."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from ._isotherm import Loan
    from ._records import Records


# How a flag of the command is said in Python. All other options have the same name and value.
FLAGS = {
    "alignment": "alignment=True",
    "from": "start",
    "no-alignment": "alignment=False",
    "no-misalignment": "misalignment=False",
    "other-device": "other_device=True",
    "to": "end",
}
OPTION = re.compile(
    r"`[^`]*`"  # a command, which stays
    r"|(?<![\w-])--(?:(?P<names>accept|drop|require) (?P<text>\w[\w=./,-]*\w)"
    r"|(?P<option>[a-z][a-z-]*)(?: (?P<value>-?\d[\w./,-]*(?<=\w)|[A-Z][A-Z,]*\b))?)"
)


def in_python(message: str) -> str:
    """A message of the library with the arguments of Python in the place of the command's options."""

    def argument(found: re.Match[str]) -> str:
        names, text, option, value = found.group("names", "text", "option", "value")
        if names:
            return f'{names}="{text}"' if names == "require" else f'{names}=["{text}"]'
        if not option:
            return found[0]
        name = FLAGS.get(option, option.replace("-", "_"))
        if value is None:
            return name
        if option == "exclude":
            value = f"[({value.replace('/', ', ')})]" if "/" in value else f"[{value}]"
        elif "," in value:
            value = f"({value.replace(',', ', ')})"
        return f"{name}={value}"

    return OPTION.sub(argument, message)


class IsothermError(Exception):
    """Base class of all; raised itself if no subclass is more specific.

    An exception can be pickled and copied with its attributes. Two are equal if class, message and attributes are.
    """

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and isinstance(other, IsothermError) and self._parts() == other._parts()

    def __hash__(self) -> int:
        return hash((type(self), str(self)))

    def _parts(self) -> tuple[Any, ...]:
        """What makes it equal to another; of arrays the bytes."""
        plain = {name: (value.dtype, value.tobytes()) if isinstance(value, (np.ndarray, np.void)) else value for name, value in vars(self).items()}
        return self.args, plain


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

    `sample` was not sent. `Acquisition.keep` it, or send it later. Pickled or copied, a loan becomes a record of RAW_SAMPLE, None if it has
    been sent.
    """

    def __init__(self, message: str, sample: Loan | Any = None) -> None:
        super().__init__(message)
        self.sample = sample

    def __reduce__(self) -> tuple[Any, ...]:
        sample = self.sample
        if hasattr(sample, "to_numpy"):
            try:
                sample = sample.to_numpy()
            except IsothermError:
                sample = None
        return type(self), self.args, vars(self) | {"sample": sample}


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

    def __init__(self, message: str, faults: Sequence[tuple[int, str, str]] = ()) -> None:
        super().__init__(message)
        self.faults = list(faults)


class RecordingFault(IsothermError, ValueError):
    """A recording cannot be read. `line` is the line of the file, from 1; for an array it is the row, from 0; None where there is none."""

    def __init__(self, message: str, line: int | None = None) -> None:
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
