"""Files are staged: written under a temporary name, then renamed. So a reader sees the old file or the complete new one."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime, timezone
from pathlib import Path


@contextmanager
def staged(path: str | os.PathLike[str]) -> Iterator[str]:
    """Gives the name of a temporary file, which is renamed to `path` at the end. Pipes and devices are written directly."""
    target = os.path.realpath(path)
    if os.path.exists(target) and not os.path.isfile(target):
        yield target
        return
    descriptor, name = tempfile.mkstemp(prefix=".isotherm-", dir=os.path.dirname(target))
    try:
        try:
            # An existing file keeps its permissions; a new one gets those of the umask.
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
    """Writes `text` as UTF-8, by a staged file."""
    with staged(path) as name:
        Path(name).write_text(text, encoding="utf-8")


def now() -> str:
    """The present time to the second, RFC 3339 in UTC."""
    return datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
