"""Puts the viewer together: who is there, their pictures, the page."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from mkdaemon.client import Vehicle
from mkdaemon.client.fleet import Fleet
from mkdaemon.view.page.gallery import Gallery
from mkdaemon.view.page.server import PageServer


@asynccontextmanager
async def serving(uav: Vehicle, port: int) -> AsyncIterator[str]:
    """Serve the page while the context lasts; its address.

    Args:
        uav: a client at the endpoint; its vehicle is shown first.
        port: of 127.0.0.1; 0 for one that is free.

    Raises:
        ConfigError: the port is in use.
    """
    gallery = Gallery(Fleet(uav), uav.vehicle)
    server = PageServer(gallery, asyncio.get_running_loop().time)
    async with gallery.open(), server.open(port):
        yield server.address
