"""The page's server: only our own page is answered, and what it is told is what the picture shows."""

from __future__ import annotations

import asyncio
import json
import zlib

import pytest

from mkdaemon.errors import ConfigError, MkError
from mkdaemon.telemetry.play import PlayAction
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.view.page.picture import VehiclePicture
from mkdaemon.view.page.server import PageServer
from tests import samples

NOW = 50.0


class Stand:
    """One picture, and what was asked of it."""

    def __init__(self) -> None:
        picture = VehiclePicture("mk1")
        for suffix, value in [*samples.hovering(1000.0), ("vision/down/image", samples.image(1000.0, sequence=3))]:
            picture.take(suffix, value, NOW)
        self.pictures = {"mk1": picture}
        self.asked: list[object] = []

    def choose(self, wanted: str) -> VehiclePicture | None:
        return self.pictures.get(wanted or "mk1")

    async def abort(self, word: str) -> str:
        self.asked.append(("abort", word))
        raise refuse(Token.NOTHING_FLOWN)

    async def release(self, word: str) -> str:
        self.asked.append(("release", word))
        return "released"

    async def play(self, word: str, action: PlayAction, **fields: float) -> str:
        self.asked.append((word, action, fields))
        raise MkError("nobody plays")


@pytest.fixture
def stand():
    return Stand()


@pytest.fixture
async def server(stand):
    made = PageServer(stand, lambda: NOW)
    async with made.open(0):
        yield made


@pytest.fixture
def port(server):
    return int(server.address.rsplit(":", 1)[1].strip("/"))


async def ask(port: int, path: str, method: str = "GET", body: str = "", **headers: str) -> tuple[str, bytes]:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    lines = {"Host": f"127.0.0.1:{port}", "Content-Length": str(len(body))} | headers
    head = "".join(f"{name.replace('_', '-')}: {value}\r\n" for name, value in lines.items())
    writer.write(f"{method} {path} HTTP/1.1\r\n{head}\r\n{body}".encode())
    answer = await reader.read()
    writer.close()
    head, _, content = answer.partition(b"\r\n\r\n")
    return head.decode(), content


async def token_of(port: int) -> str:
    _, content = await ask(port, "/")
    return content.decode().partition('page-token" content="')[2].partition('"')[0]


async def test_the_page_and_its_files_come_from_here_and_nowhere_else(server, port):
    assert server.address == f"http://127.0.0.1:{port}/"
    for path in ("/", "/page.js", "/scene.js", "/plots.js", "/style.css"):
        head, content = await ask(port, path)
        assert head.startswith("HTTP/1.1 200 ") and "default-src 'none'" in head
        assert content and b"http://" not in content and b"https://" not in content
    assert (await ask(port, "/server.py"))[0].startswith("HTTP/1.1 404 ")
    assert len(await token_of(port)) > 16


async def test_another_name_that_leads_here_is_refused(port):
    head, content = await ask(port, "/stream", Host=f"evil.example:{port}")
    assert head.startswith("HTTP/1.1 403 ") and b"the page is at http://127.0.0.1" in content


@pytest.mark.parametrize("headers", [{}, {"X_Page": "guessed"}, {"X_Page": "\xe9\xff"}])
async def test_another_page_cannot_press_a_button(stand, port, headers):
    head, _ = await ask(port, "/release", "POST", '{"vehicle":"mk1"}', **headers)
    assert head.startswith("HTTP/1.1 403 ")
    assert stand.asked == []


async def test_buttons_do_what_they_say_and_tell_what_came_of_it(stand, port):
    word = await token_of(port)
    _, done = await ask(port, "/release", "POST", '{"vehicle":"mk1"}', X_Page=word)
    assert json.loads(done) == {"is_done": True, "text": "released", "fix": ""}
    _, refused = await ask(port, "/abort", "POST", '{"vehicle":"mk1"}', X_Page=word)
    assert json.loads(refused)["is_done"] is False and json.loads(refused)["fix"]
    asked = '{"vehicle":"mk1","action":"speed","speed":2}'
    _, failed = await ask(port, "/play", "POST", asked, X_Page=word)
    assert json.loads(failed)["text"] == "nobody plays"
    assert stand.asked == [("release", "mk1"), ("abort", "mk1"), ("mk1", PlayAction.SPEED, {"speed": 2.0})]


@pytest.mark.parametrize(
    ("path", "body", "status"),
    [
        ("/release", "[1]", 400),
        ("/release", "{", 400),
        ("/play", '{"action":"leap"}', 400),
        ("/play", '{"action":"seek","place":"there"}', 400),
        ("/play", '{"action":["speed"],"speed":1}', 400),
        ("/play", '{"action":"seek","place":' + "9" * 400 + "}", 400),
        ("/play", '{"action":"seek","place":NaN}', 400),
        ("/arm", "{}", 404),
        ("/release", '{"vehicle":"' + "x" * 5000 + '"}', 413),
    ],
)
async def test_what_is_no_button_is_refused(stand, port, path, body, status):
    head, _ = await ask(port, path, "POST", body, X_Page=await token_of(port))
    assert head.startswith(f"HTTP/1.1 {status} ")
    assert stand.asked == []


@pytest.mark.parametrize("sent", [b"\r\n\r\n", b"GET\r\n\r\n", b"\x80" * 20_000, b"GET / HTTP/1.1\r\nHost"])
async def test_no_http_ends_the_connection(port, sent):
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(sent)
    writer.write_eof()
    answer = await reader.read()
    assert answer == b"" or answer.startswith(b"HTTP/1.1 4")
    writer.close()
    assert (await ask(port, "/"))[0].startswith("HTTP/1.1 200 ")


async def test_a_page_is_streamed_what_the_picture_shows(port):
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(f"GET /stream HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n".encode())
    head = await reader.readuntil(b"\r\n\r\n")
    assert b"text/event-stream" in head
    shown = [json.loads((await reader.readuntil(b"\n\n"))[6:]) for _ in range(2)]
    writer.close()
    assert [len(one["series"]) for one in shown] == [7, 0]
    assert shown[0]["vehicles"] == [{"id": "mk1", "is_here": True, "is_played": False}]
    assert shown[1]["scene"]["aircraft"]["position"] == [0.12, -0.05, 2.01]


async def test_a_grey_image_is_shown_as_png(port):
    head, png = await ask(port, "/image?vehicle=mk1&camera=down&n=3")
    assert "image/png" in head
    start = png.index(b"IDAT") + 4
    length = int.from_bytes(png[start - 8 : start - 4], "big")
    assert zlib.decompress(png[start : start + length]) == b"\0\0\1\2\3\0\4\5\6\7\0\x08\t\n\x0b"
    assert (await ask(port, "/image?vehicle=mk1&camera=up"))[0].startswith("HTTP/1.1 404 ")


async def test_a_page_that_stops_reading_is_given_nothing_more_and_holds_up_nobody(stand, port):
    stuck = stand.pictures["mk1"]
    stand.pictures["mk2"] = VehiclePicture("mk2")
    made = 0
    show = stuck.show

    def count(now: float) -> dict[str, object]:
        nonlocal made
        made += 1
        return show(now) | {"padding": "x" * 400_000}

    stuck.show = count
    _, idle = await asyncio.open_connection("127.0.0.1", port, limit=1024)
    idle.write(f"GET /stream?vehicle=mk1 HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n".encode())
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(f"GET /stream?vehicle=mk2 HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n".encode())
    counts = []
    for _ in range(60):
        await reader.readuntil(b"\n\n")
        counts.append(made)
    assert 0 < counts[-1] == counts[30] < 30  # what the sockets hold, and then nothing
    idle.transport.abort()
    writer.transport.abort()


async def test_a_port_in_use_is_named(stand, port):
    other = PageServer(stand, lambda: NOW)
    with pytest.raises(ConfigError, match=f"--port {port}"):
        async with other.open(port):
            pass
