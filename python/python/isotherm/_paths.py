"""The files of recordings, by names and patterns."""

from __future__ import annotations

import errno
import glob
import os
from collections.abc import Iterable
from pathlib import Path
from typing import TypeAlias

AnyPath: TypeAlias = str | os.PathLike[str]


def is_path(value: object) -> bool:
    return isinstance(value, (str, os.PathLike))


def paths(named: AnyPath | Iterable[AnyPath]) -> list[Path]:
    """The files of these names. A name with `*`, `?` or `[` that no file has stands for all files that it fits, in order of their names."""
    names = [named] if isinstance(named, (str, os.PathLike)) else list(named)
    return [path for name in names for path in _fitting(os.fspath(name))]


def _fitting(name: str) -> list[Path]:
    if not glob.has_magic(name) or os.path.exists(name):
        return [Path(name)]
    found = sorted(glob.glob(name))
    if not found:
        raise FileNotFoundError(errno.ENOENT, "no file has a name like this", name)
    return [Path(path) for path in found]
