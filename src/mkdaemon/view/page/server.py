"""Serves the page: its files, what it shows as a stream of events, images, and the two buttons.

A page that is slow, stopped or gone delays nothing: a message is made when the page can take it, so a slow page gets
fewer messages, and none of them late.
"""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from http import HTTPStatus
from importlib.resources import files
from typing import Any, Final

from pydantic import ValidationError

from mkdaemon.client.pictures import viewable
from mkdaemon.errors import CommandRejectedError, ConfigError, MkError
from mkdaemon.telemetry.play import PlayControl
from mkdaemon.view.page.gallery import Gallery
from mkdaemon.view.page.http import LONGEST_HEAD, BadRequestError, HttpRequest, answer, event, read_request, stream_head
from mkdaemon.view.page.picture import PageReader, VehiclePicture

HOST: Final = "127.0.0.1"
PERIOD: Final = 1 / 15
"""Between two pictures of a page [s]."""
ROOM: Final = 65_536
"""What waits in a connection before its page is given nothing more [bytes]."""
STUCK: Final = 20.0
"""A page that takes nothing for this time is disconnected [s]; a live page connects again."""
_FILES: Final = {
    "/": ("index.html", "text/html; charset=utf-8"),
    "/page.js": ("page.js", "text/javascript; charset=utf-8"),
    "/scene.js": ("scene.js", "text/javascript; charset=utf-8"),
    "/plots.js": ("plots.js", "text/javascript; charset=utf-8"),
    "/style.css": ("style.css", "text/css; charset=utf-8"),
}
_TOKEN: Final = b"{{token}}"


class PageServer:
    """Serves one gallery.

    Attributes:
        address: of the page, once it is open.
    """

    def __init__(self, gallery: Gallery, now: Callable[[], float]) -> None:
        """Prepare; `open` serves.

        Args:
            gallery: what is shown, and who does what the buttons ask for.
            now: the time of the pictures [s], of the same clock as the arrival of values.
        """
        self.address = ""
        self._gallery = gallery
        self._now = now
        self._token = secrets.token_urlsafe(16)
        self._hosts: frozenset[str] = frozenset()
        self._tasks: set[asyncio.Task[None]] = set()

    @asynccontextmanager
    async def open(self, port: int) -> AsyncIterator[None]:
        """Serve while the context lasts.

        Args:
            port: of 127.0.0.1; 0 for one that is free.

        Raises:
            ConfigError: the port is in use.
        """
        try:
            server = await asyncio.start_server(self._connected, HOST, port, limit=LONGEST_HEAD)
        except OSError as error:
            msg = f"--port {port}: {error.strerror or error}; end what uses it, or give another one (0: any)"
            raise ConfigError(msg) from error
        port = server.sockets[0].getsockname()[1]
        self._hosts = frozenset({f"{HOST}:{port}", f"localhost:{port}"})
        self.address = f"http://{HOST}:{port}/"
        try:
            yield
        finally:
            server.close()
            for task in self._tasks:
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        writer.transport.set_write_buffer_limits(ROOM)
        try:
            with suppress(ConnectionError, TimeoutError):
                await self._serve(reader, writer)
        finally:
            writer.transport.abort() if writer.transport.get_write_buffer_size() > ROOM else writer.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            request = await read_request(reader)
            if request is None:
                return
            self._check(request)
            if request.path == "/stream":
                await self._stream(request, writer)
                return
            body = await self._answer(request)
        except BadRequestError as error:
            body = answer(f"{error}\n".encode(), "text/plain; charset=utf-8", error.status)
        writer.write(body)
        async with asyncio.timeout(STUCK):
            await writer.drain()

    def _check(self, request: HttpRequest) -> None:
        """Refuse who is not our page.

        Raises:
            BadRequestError: another host's name leads here, or another page asks for something to be done.
        """
        if request.headers.get("host") not in self._hosts:
            raise BadRequestError(HTTPStatus.FORBIDDEN, f"the page is at {self.address}")
        if request.method == "POST":
            # As bytes: it compares no text that is not ASCII.
            if not secrets.compare_digest(request.headers.get("x-page", "").encode(), self._token.encode()):
                raise BadRequestError(HTTPStatus.FORBIDDEN, "only the page itself may ask; load it again")
        elif request.method != "GET":
            raise BadRequestError(HTTPStatus.METHOD_NOT_ALLOWED, "GET or POST")

    async def _answer(self, request: HttpRequest) -> bytes:
        """Answer what is not a stream.

        Raises:
            BadRequestError: there is no such thing.
        """
        if request.method == "POST":
            return await self._do(request)
        if request.path in _FILES:
            name, kind = _FILES[request.path]
            content = files(__package__).joinpath("static", name).read_bytes()
            return answer(content.replace(_TOKEN, self._token.encode()), kind)
        if request.path == "/image":
            picture = self._gallery.pictures.get(request.query.get("vehicle", ""))
            image = None if picture is None else picture.image(request.query.get("camera", ""))
            if image is not None:
                pixels, coding = viewable(image)
                return answer(pixels, f"image/{coding}")
        raise BadRequestError(HTTPStatus.NOT_FOUND, "there is nothing here")

    async def _stream(self, request: HttpRequest, writer: asyncio.StreamWriter) -> None:
        """Tell a page what to show until it goes; as often as it can take it."""
        gallery, loop = self._gallery, asyncio.get_running_loop()
        wanted, reader, due = request.query.get("vehicle", ""), None, loop.time()
        writer.write(stream_head())
        while not writer.is_closing():
            picture = gallery.choose(wanted)
            if picture is not None:
                wanted = picture.name
                if reader is None or reader.picture is not picture:
                    reader = PageReader(picture)
            shown: dict[str, Any] = {} if reader is None else reader.read(self._now())
            shown["vehicles"] = [_label(word, found) for word, found in sorted(gallery.pictures.items())]
            writer.write(event(shown))
            async with asyncio.timeout(STUCK):
                await writer.drain()
            due = max(due + PERIOD, loop.time())
            await asyncio.sleep(due - loop.time())

    async def _do(self, request: HttpRequest) -> bytes:
        """Do what a button asks for; the answer says how it went.

        Raises:
            BadRequestError: there is no such button.
        """
        fields, gallery = request.fields, self._gallery
        vehicle = str(fields.get("vehicle", ""))
        buttons: dict[str, Callable[[], Awaitable[str]]] = {
            "/abort": lambda: gallery.abort(vehicle),
            "/release": lambda: gallery.release(vehicle),
            "/play": lambda: gallery.play(vehicle, **_asked_of_player(fields)),
        }
        if request.path not in buttons:
            raise BadRequestError(HTTPStatus.NOT_FOUND, "there is no such button")
        try:
            outcome = {"is_done": True, "text": await buttons[request.path](), "fix": ""}
        except CommandRejectedError as refusal:
            outcome = {"is_done": False, "text": refusal.reason, "fix": refusal.fix}
        except MkError as error:
            outcome = {"is_done": False, "text": str(error), "fix": ""}
        return answer(event(outcome)[6:], "application/json")


def _label(word: str, picture: VehiclePicture) -> dict[str, Any]:
    return {"id": word, "is_here": picture.is_here, "is_played": picture.is_played}


def _asked_of_player(fields: dict[str, Any]) -> dict[str, Any]:
    """What a page asks of a player, as `Gallery.play` takes it.

    Raises:
        BadRequestError: it is nothing that a player does.
    """
    try:
        asked = PlayControl.model_validate({name: fields[name] for name in PlayControl.model_fields if name in fields})
    except ValidationError as error:
        raise BadRequestError(HTTPStatus.BAD_REQUEST, str(error.errors()[0]["msg"])) from None
    return asked.model_dump(exclude_unset=True)
