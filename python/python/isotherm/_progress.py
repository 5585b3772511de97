"""Progress of long functions: a callback, or a bar of tqdm."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import TypeAlias

# Called with what is done and what there is, in bytes of files or rows of arrays; or True for a bar.
Progress: TypeAlias = bool | Callable[[int, int], object]


@contextmanager
def shown(progress: Progress, name: str) -> Iterator[Callable[[int, int], object] | None]:
    """The callback that the native function takes. With True it draws a bar of tqdm, as a widget in a notebook."""
    if not isinstance(progress, bool):
        if not callable(progress):
            raise TypeError(f"progress is {progress!r}, give a function of (done, total), or True for a bar of tqdm")
        yield progress
        return
    if not progress:
        yield None
        return
    try:
        # By name: its types are not everywhere.
        tqdm = import_module("tqdm.auto").tqdm
    except ImportError as error:
        raise ImportError("progress=True draws a bar of tqdm: pip install tqdm, or give a function of (done, total)") from error
    with tqdm(desc=name, unit_scale=True) as bar:

        def update(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        yield update
