"""`mkctl camera`: what a camera sees, how well, and what to change."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from mkdaemon.cli.arguments import Length
from mkdaemon.cli.console import Console
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.printing import json_line
from mkdaemon.cli.terminal import on_one_line
from mkdaemon.errors import MkError
from mkdaemon.files import refuse_existing

if TYPE_CHECKING:
    from rich.console import Group

    from mkdaemon.client.cameralook import CameraLook

COLUMNS: Final = 60
"""Of the picture, at most."""
ROWS: Final = 15
"""Of the picture, at most: beside the figures it fits into 24."""
IMAGE_TIME: Final = 2.0
"""Longest wait for an image that is to be written or printed once [s]."""
NO_IMAGE: Final = "no image on the bus: set jpeg_hz = 2 in the camera's section of the configuration"


async def camera(
    name: str = "",
    /,
    *,
    once: bool = False,
    seconds: Length | None = None,
    picture: Path | None = None,
    force: bool = False,
    connection: Connection = HERE,
) -> None:
    """Show what a camera sees, live: the picture with its tags, exposure, blur, rate, latency, and what to change.

    The picture needs `jpeg_hz` in the camera's section. `mkctl view` shows it in the browser.

    Example: mkctl camera down --picture found.png

    Args:
        name: Of the camera; not needed where there is one.
        once: Print what is known now and end; this is also what happens without a terminal.
        seconds: End after this time [s].
        picture: Write the newest image with its tags into this file (.png, .jpg), and end.
        force: Overwrite a picture that is there.

    Raises:
        ConfigError: the picture is there already, or a number cannot be.
        MkError: there is no such camera, or no image to write.
    """
    from rich.live import Live

    from mkdaemon.client.cameralook import CameraLook, find_camera

    if picture is not None:
        refuse_existing(picture, overwrite=force)
    console = Console()
    async with connection.open() as uav:
        look = CameraLook(await find_camera(uav, name))
        async with uav.watch(*look.keys, backlog=32) as samples:
            for key in look.keys:
                for sample in (await uav.get_all(key)).values():
                    look.take(sample)
            if once or picture is not None or connection.json or not console.is_terminal:
                await _wait_for_image(samples, look)
                _print_once(look, picture, console, connection, overwrite=force)
                return
            with Live(render(look, console), console=console, refresh_per_second=4) as live, suppress(TimeoutError):
                async with asyncio.timeout(seconds):
                    async for sample in samples:
                        look.take(sample)
                        live.update(render(look, console))


async def _wait_for_image(samples: Any, look: CameraLook) -> None:
    """Take values until there is an image with its tags, or none comes."""
    with suppress(TimeoutError):
        async with asyncio.timeout(IMAGE_TIME):
            async for sample in samples:
                look.take(sample)
                if look.pixels is not None and look.tags is not None:
                    return


def _print_once(
    look: CameraLook, picture: Path | None, console: Console, connection: Connection, *, overwrite: bool
) -> None:
    if picture is not None:
        if look.pixels is None:
            raise MkError(NO_IMAGE)
        look.write_picture(picture, overwrite=overwrite)
        console.print(f"{picture}: {look.pixels.shape[1]}x{look.pixels.shape[0]}, {len(look.outlines())} tags")
        return
    if connection.json:
        stats = None if look.stats is None else look.stats.model_dump(mode="json")
        tags = [] if look.tags is None else [tag.model_dump(mode="json") for tag in look.tags.tags]
        found = {"camera": look.name, "stats": stats, "tags": tags, "softness": look.softness, "advice": look.advice()}
        print(json_line(found))
        return
    console.print(render(look, console))


def render(look: CameraLook, console: Console) -> Group:
    """The screen: figures, what to change, the picture."""
    from rich.console import Group
    from rich.text import Text

    from mkdaemon.view.halfblocks import picture_rows

    lines = [Text(line, overflow="ellipsis", no_wrap=True) for line in figures(look)]
    advice = [Text(f"change: {on_one_line(words)}", style="bold yellow") for words in look.advice()]
    if look.pixels is None:
        return Group(*lines, *(advice or [Text("nothing to change")]), Text(NO_IMAGE, style="dim"))
    outlines = [corners for _, corners in look.outlines()]
    has_colours = console.color_system in ("truecolor", "256")
    drawn = picture_rows(look.pixels, outlines, COLUMNS, ROWS, has_colours=has_colours)
    return Group(*lines, *(advice or [Text("nothing to change")]), *drawn)


def figures(look: CameraLook) -> list[str]:
    """What is known of a camera, a line each."""
    from mkdaemon.client.cameralook import tag_words

    stats = look.stats
    if stats is None:
        return [f"camera {on_one_line(look.name)}: not heard yet"]
    light = "chosen by the camera or its driver"
    if (exposure := stats.exposure) is not None:
        levels = "" if exposure.white is None else f", black {exposure.black:.0f} white {exposure.white:.0f}"
        light = f"{exposure.exposure_ms:.1f} ms, gain {exposure.gain:.1f}{levels}"
    soft = "unknown" if look.softness is None else f"edges {look.softness:.2f} of a cell soft"
    tags = "none" if look.tags is None else tag_words(look.tags.tags)
    slowest = f"99 % {stats.latency_p99_ms:.0f} ms; detector {stats.detect_p50_ms:.0f} ms"
    bad = f"{stats.dropped} dropped, {stats.lost} lost, {stats.damaged} damaged"
    return [
        f"camera {on_one_line(look.name)}: {stats.state}, {stats.width}x{stats.height}, {on_one_line(stats.source)}",
        f"rate     {stats.fps:.1f} images a second; {bad}",
        f"latency  {stats.latency_p50_ms:.0f} ms, {slowest}",
        f"exposure {light}; blur: {soft}",
        f"tags     {tags}; {100 * stats.posed:.0f} % of the images gave a pose",
        f"target   {on_one_line(look.target) or 'none seen'}",
    ]
