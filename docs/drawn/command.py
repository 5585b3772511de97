"""What all pictures share: the command that makes their data, and the list of pictures."""

import functools
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
FOLDER = ROOT / "docs/pictures"
PICTURES: dict[str, Callable[[], str]] = {}


def picture(name: str) -> Callable[[Callable[[], str]], Callable[[], str]]:
    def keep(made: Callable[[], str]) -> Callable[[], str]:
        PICTURES[name] = made
        return made

    return keep


@functools.cache
def scratch() -> Path:
    """A folder for what the commands write."""
    kept = tempfile.TemporaryDirectory(prefix="isotherm-pictures-")
    scratch.kept = kept  # type: ignore[attr-defined]
    return Path(kept.name)


@functools.cache
def isotherm(*words: str, fails: bool = False) -> str:
    """What the command prints. It runs once for the same words, in the scratch folder."""
    ended = subprocess.run(["isotherm", *words], cwd=scratch(), capture_output=True, text=True)
    if (ended.returncode != 0) != fails:
        sys.exit(f"isotherm {' '.join(words)}: exit code {ended.returncode}\n{ended.stderr}")
    return ended.stdout
