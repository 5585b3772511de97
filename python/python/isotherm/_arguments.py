"""Wrong arguments are named, with what they may be."""

from __future__ import annotations

from numbers import Real
from types import NoneType
from typing import Any

KINDS: dict[str, tuple[tuple[type, ...], str]] = {
    "alignment": ((bool, NoneType), "True, False or None"),
    "at": ((Real, NoneType), "a temperature or None"),
    "imu": ((str, NoneType), "the name of an IMU, for example \"imu-a\""),
    "lag": ((Real, NoneType), 'a time constant in s, "none" or None'),
    "misalignment": ((bool,), "True or False"),
    "strict": ((bool,), "True or False"),
    "other_device": ((bool,), "True or False"),
}
NUMBER = ((Real, NoneType), "a number")


def check(**arguments: Any) -> None:
    """Raises TypeError for an argument of another type than it may have: that of its name, or else a number or None."""
    for name, value in arguments.items():
        kinds, allowed = KINDS.get(name, NUMBER)
        if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
            raise TypeError(f"{name} is {value!r}, give {allowed}")


def texts(name: str, values: Any) -> list[str]:
    """Names of an argument, as a list; a single one may be given as it is."""
    every = [values] if isinstance(values, str) else list(values)
    for value in every:
        if not isinstance(value, str):
            raise TypeError(f"{name} has {value!r}, give a list of texts")
    return every
