"""`async for` over the increments of a reader."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import TYPE_CHECKING

from ._errors import NoService

if TYPE_CHECKING:
    from ._isotherm import Increment, IncrementReader

# A notification can be lost, and a service may come: so often a reader looks by itself [s].
LOOK = 0.1


async def increments(reader: IncrementReader) -> AsyncIterator[Increment]:
    """Every increment when it comes; ends when the reader is closed."""
    while not reader.closed:
        if (increment := reader.receive()) is not None:
            yield increment
        else:
            await _may_have_come(reader)


async def _may_have_come(reader: IncrementReader) -> None:
    """Sleeps until the descriptor of the reader is readable, at most `LOOK`."""
    loop, come = asyncio.get_running_loop(), asyncio.Event()
    try:
        descriptor = reader.fileno()
    except NoService:
        await asyncio.sleep(LOOK)
        return
    loop.add_reader(descriptor, come.set)
    try:
        async with asyncio.timeout(LOOK):
            await come.wait()
    except TimeoutError:
        pass
    finally:
        loop.remove_reader(descriptor)
