"""Files are staged: written under a temporary name, then renamed. So a reader sees the old file or the complete new one."""

from __future__ import annotations

import os
import signal
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeAlias

AnyPath: TypeAlias = str | os.PathLike[str]


class _Staged:
    """A file under a temporary name. A pipe or a device has no temporary name and is written directly."""

    def __init__(self, path: AnyPath) -> None:
        self.target = os.path.realpath(path)
        self.name = self.target
        self.direct = os.path.exists(self.target) and not os.path.isfile(self.target)
        if self.direct:
            return
        descriptor, self.name = tempfile.mkstemp(prefix=".isotherm-", dir=os.path.dirname(self.target))
        try:
            # An existing file keeps its permissions; a new one gets those of the umask.
            mode = os.stat(self.target).st_mode & 0o777
        except FileNotFoundError:
            umask = os.umask(0)
            os.umask(umask)
            mode = 0o666 & ~umask
        try:
            os.fchmod(descriptor, mode)
        finally:
            os.close(descriptor)

    def write(self, text: str) -> None:
        """Writes `text` as UTF-8."""
        Path(self.name).write_text(text, encoding="utf-8")
        self.sync()

    def sync(self) -> None:
        """Makes the content durable."""
        if not self.direct:
            _sync(self.name)

    def remove_old(self) -> None:
        """Removes the file that is about to be replaced."""
        if not self.direct and os.path.isfile(self.target):
            os.unlink(self.target)
            with suppress(OSError):  # Some file systems cannot sync a folder.
                _sync(os.path.dirname(self.target))

    def rename(self) -> None:
        """Gives the file its name."""
        if not self.direct:
            os.replace(self.name, self.target)

    def discard(self) -> None:
        """Removes the file if it still has its temporary name."""
        if not self.direct:
            with suppress(FileNotFoundError):
                os.unlink(self.name)


def _sync(path: str) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def staged(path: AnyPath) -> Iterator[str]:
    """Gives the name of a temporary file, which is renamed to `path` at the end. Pipes and devices are written directly."""
    file = _Staged(path)
    try:
        yield file.name
        file.sync()
        file.rename()
    finally:
        file.discard()


def write_text(path: AnyPath, text: str) -> None:
    """Writes `text` as UTF-8, by a staged file."""
    with staged(path) as name:
        Path(name).write_text(text, encoding="utf-8")


def write_together(texts: list[tuple[AnyPath, str]]) -> None:
    """Writes texts that belong together, the one that matters first, as a table before its report: all or none.

    SIGKILL or a power failure may leave fewer, but never an old file beside a new one: the old files after the first are
    removed before the first is renamed. SIGINT, SIGTERM and SIGHUP to this thread wait meanwhile.
    """
    files: list[_Staged] = []
    try:
        for path, text in texts:
            files.append(_Staged(path))
            files[-1].write(text)
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM, signal.SIGHUP})
        try:
            for file in files[1:]:
                file.remove_old()
            for file in files:
                file.rename()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
    finally:
        for file in files:
            file.discard()
