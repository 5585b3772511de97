"""Results are staged: written under a temporary name, then renamed. So a reader sees the old file or the complete new one."""

from __future__ import annotations

import signal

from . import _isotherm
from ._paths import AnyPath


def write_text(path: AnyPath, text: str) -> None:
    """Writes `text` as UTF-8, by a staged file."""
    write_together([(path, text)])


def write_together(texts: list[tuple[AnyPath, str]]) -> None:
    """Writes texts that belong together, the one that matters first, as a table before its report: all or none.

    SIGKILL or a power failure may leave fewer, but never an old file next to a new one: the old files after the first get hidden names
    before the first is renamed. SIGINT, SIGTERM and SIGHUP to this thread wait meanwhile.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM, signal.SIGHUP})
    try:
        _isotherm.write_texts(texts)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
