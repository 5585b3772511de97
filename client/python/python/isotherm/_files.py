"""Files are written aside and renamed, so that an old one is whole until the new one is."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime, timezone
from pathlib import Path


@contextmanager
def aside(path: str | os.PathLike[str]) -> Iterator[str]:
    """The name of a file that becomes `path` at the end; pipes and devices are written straight."""
    target = os.path.realpath(path)
    if os.path.exists(target) and not os.path.isfile(target):
        yield target
        return
    descriptor, name = tempfile.mkstemp(prefix=".isotherm-", dir=os.path.dirname(target))
    try:
        try:
            # Another's file keeps its permissions; a new one gets the usual ones.
            mode = os.stat(target).st_mode & 0o777
        except FileNotFoundError:
            umask = os.umask(0)
            os.umask(umask)
            mode = 0o666 & ~umask
        os.fchmod(descriptor, mode)
        yield name
        os.fsync(descriptor)
        os.replace(name, target)
    except BaseException:
        os.unlink(name)
        raise
    finally:
        os.close(descriptor)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Writes `text` as UTF-8."""
    with aside(path) as name:
        Path(name).write_text(text, encoding="utf-8")


def now() -> str:
    """The time to the second, RFC 3339 in UTC."""
    return datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
