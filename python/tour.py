#!/usr/bin/env python3
"""Runs examples/python/tour.ipynb and writes its outputs into it. Needs what tests/requirements.txt names.

With --check it writes nothing: the texts that the cells print must be those in the file, and the figures must be there.
"""

import copy
import sys
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient

PATH = Path(__file__).parents[1] / "examples/python/tour.ipynb"


def shown(notebook: Any) -> list[list[Any]]:
    """What each cell shows: texts as they are, of figures and pages that they are there."""
    of_cells = [cell.get("outputs", ()) for cell in notebook.cells]
    return [[(output.get("text"), output.get("data", {}).get("text/plain"), sorted(output.get("data", ()))) for output in outputs] for outputs in of_cells]


def run() -> tuple[Any, Any]:
    """The notebook as it is in the file, and as it is now."""
    before: Any = nbformat.read(PATH, as_version=4)  # type: ignore[no-untyped-call]
    now = copy.deepcopy(before)
    NotebookClient(now, timeout=120, kernel_name="python3", resources={"metadata": {"path": str(PATH.parent)}}).execute()
    return before, now


def main(arguments: list[str]) -> int:
    before, now = run()
    if arguments == ["--check"]:
        return int(shown(before) != shown(now))
    for cell in now.cells:
        # When a cell ran is nothing that a reader needs.
        cell.metadata.pop("execution", None)
    nbformat.write(now, PATH)  # type: ignore[no-untyped-call]
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
