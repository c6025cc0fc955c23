"""The page's picture for the documentation: a moment of the demonstration, flown in virtual time, in Chromium."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from playwright.sync_api import ViewportSize
from pydantic import BaseModel

from lab.rigs.browsing import chromium
from mkdaemon.errors import MkError
from mkdaemon.telemetry.play import PlayAction
from mkdaemon.view.page.picture import VehiclePicture
from mkdaemon.view.page.server import PageServer
from mkdaemon.virtualtime import run_virtually
from mksim.programs.rehearsal import demonstration, simulated_aircraft

MOMENT: Final = 34.2
"""Of the demonstration [s]: it flies a step of 1 m."""
SIZE: Final[ViewportSize] = {"width": 1440, "height": 900}
"""Of the picture [px]."""
DRAWN: Final = 3000
"""A machine without graphics draws the page in less [ms]."""
NAME: Final = "demo"


class Still:
    """A gallery of one picture that stands still.

    Attributes:
        pictures: the one.
    """

    def __init__(self, picture: VehiclePicture) -> None:
        """Show it."""
        self.pictures = {picture.name: picture}

    def choose(self, wanted: str) -> VehiclePicture | None:
        """The one."""
        return self.pictures.get(wanted or NAME)

    async def abort(self, word: str) -> str:
        """Nothing flies here.

        Raises:
            MkError: always.
        """
        raise MkError(f"{word} stands still")

    async def release(self, word: str) -> str:
        """Nothing flies here; see `abort`."""
        return await self.abort(word)

    async def play(self, word: str, action: PlayAction, **fields: float) -> str:
        """Nothing is played here; see `abort`."""
        return await self.abort(word)


def picture_at(moment: float, seed: int = 1) -> VehiclePicture:
    """What the page shows at a moment of the demonstration.

    Args:
        moment: of virtual time [s].
        seed: of everything random.
    """
    picture = VehiclePicture(NAME)

    async def fly() -> None:
        loop = asyncio.get_running_loop()

        def follow(suffix: str, value: BaseModel) -> None:
            picture.take(suffix, value, loop.time())

        rehearsal = demonstration(simulated_aircraft(seed, "light", 15.0), lambda moment, status: None)
        rehearsal.watch(follow)
        flying = asyncio.create_task(rehearsal.fly(), name="flight")
        await asyncio.sleep(moment)
        rehearsal.bus.followers.clear()  # the end of the flight is not a part of the moment
        flying.cancel()
        with suppress(asyncio.CancelledError):
            await flying

    run_virtually(fly())
    return picture


@contextmanager
def serving_still(picture: VehiclePicture, moment: float) -> Iterator[str]:
    """Serve a picture that stands still, from a thread of its own; its address."""
    loop, opened = asyncio.new_event_loop(), threading.Event()
    server = PageServer(Still(picture), lambda: moment)
    ending = asyncio.Event()

    async def serve() -> None:
        async with server.open(0):
            opened.set()
            await ending.wait()

    thread = threading.Thread(target=lambda: loop.run_until_complete(serve()), name="page", daemon=True)
    thread.start()
    opened.wait()
    try:
        yield server.address
    finally:
        loop.call_soon_threadsafe(ending.set)
        thread.join()
        loop.close()


def draw(path: Path, moment: float = MOMENT) -> None:
    """Draw the picture into a PNG file.

    Args:
        path: of the file; replaced.
        moment: of the demonstration [s].
    """
    with serving_still(picture_at(moment), moment) as address, chromium() as browser:
        page = browser.new_page(viewport=SIZE)
        page.goto(address)
        page.wait_for_selector("#lines tr")
        page.wait_for_timeout(DRAWN)
        page.screenshot(path=str(path))
