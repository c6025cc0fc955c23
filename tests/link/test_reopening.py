"""Coming back under another device name, as udev keeps them, and the search for the line rate."""

from __future__ import annotations

import asyncio
import contextlib
import os
import tty
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from lab.rigs.linkrig import Log
from lab.rigs.waiting import running, wait_until
from mkdaemon.config.link import LinkConfig
from mkdaemon.errors import LinkLostError
from mkdaemon.link.discovery import discover
from mkdaemon.link.link import Link
from mkdaemon.link.session.reopening import GARBAGE_PATIENCE, SILENT_PATIENCE, STUCK_PATIENCE, AliasMemory, BaudSearch
from mkdaemon.link.session.verdict import HeldFinding, VerdictCause, VerdictFinding
from mkdaemon.protocol.framing import Frame, FrameDecoder, encode_frame
from mkdaemon.telemetry.link import LinkCondition

BY_ID = "usb-FTDI_FT232R_USB_UART_A50285BI-if00-port0"


class Adapter:
    """A pseudo terminal in the part of an adapter: its near end is where a board would be."""

    def __init__(self) -> None:
        self.near, self._far = os.openpty()
        tty.setraw(self._far)
        os.set_blocking(self.near, False)
        self.device = Path(os.ttyname(self._far))
        self._decoder = FrameDecoder()
        self._letters: list[str] = []

    def letters(self, minor: int | None = None) -> list[str]:
        """Frame letters that arrived so far, in order; a version is answered as FlightCtrl 2.`minor` does."""
        with contextlib.suppress(OSError):
            while chunk := os.read(self.near, 4096):
                new = [item.id for item in self._decoder.feed(chunk) if isinstance(item, Frame)]
                self._letters += new
                if minor is not None and "v" in new:
                    os.write(self.near, encode_frame(1, "V", bytes([2, minor, 11, 1, 0, 0, 0, 22, 100, 0])))
        return self._letters

    def unplug(self) -> None:
        for descriptor in (self.near, self._far):
            with contextlib.suppress(OSError):
                os.close(descriptor)


@pytest.fixture
def adapters() -> Iterator[tuple[Adapter, Adapter]]:
    both = (Adapter(), Adapter())  # both exist at once, so the second has another number for certain
    yield both
    for adapter in both:
        adapter.unplug()


@asynccontextmanager
async def linked(name: Path, *, by_id: Path | None = None) -> AsyncIterator[tuple[Link, list[str]]]:
    """A link that runs at a name; yields it and the names it opened."""
    opened: list[str] = []
    link = Link(LinkConfig.model_validate({"port": str(name), "probe_baud": False, "reopen_min": 0.02}), Log())
    honest = link._opener

    async def remember(url: str, *, baud: int) -> object:
        port = await honest(url, baud=baud)
        opened.append(url)
        return port

    link._opener = remember
    if by_id is not None:
        link._aliases = AliasMemory(by_id)
    async with running(link.run(discover)):
        yield link, opened


def point(name: Path, device: Path) -> None:
    """Make a name lead to a device, in one step as udev does."""
    fresh = name.with_name("#new")
    fresh.symlink_to(device)
    fresh.replace(name)


async def test_a_link_by_number_finds_its_adapter_again_under_its_by_id_name(adapters, tmp_path):
    first, second = adapters
    number, by_id = tmp_path / "ttyUSB0", tmp_path / "by-id"
    by_id.mkdir()
    point(number, first.device)
    point(by_id / BY_ID, first.device)
    async with linked(number, by_id=by_id) as (link, opened):
        await wait_until(lambda: "b" in first.letters())
        first.unplug()
        (by_id / BY_ID).unlink()
        number.unlink()
        await wait_until(lambda: link.health().state.condition.value == "absent")
        point(tmp_path / "ttyUSB1", second.device)
        point(by_id / BY_ID, second.device)
        await wait_until(lambda: "b" in second.letters())
        assert opened == [str(number), str(by_id / BY_ID)]
        assert second.letters()[0] == "b"


@pytest.fixture
def learnt(adapters, tmp_path) -> tuple[AliasMemory, Path, Path]:
    """What is remembered of the first adapter: its memory, its number, and its name by id."""
    by_id, number = tmp_path / "by-id", tmp_path / "ttyUSB0"
    by_id.mkdir()
    point(by_id / BY_ID, adapters[0].device)
    point(number, adapters[0].device)
    memory = AliasMemory(by_id)
    memory.learn(str(number))
    return memory, number, by_id / BY_ID


def test_only_its_own_adapter_at_another_number_is_an_alias(learnt, adapters):
    memory, number, name = learnt
    assert memory.find(str(number)) is None, "it is where it was"
    number.unlink()
    assert memory.find(str(number)) == str(name)
    name.unlink()
    point(name.with_name("usb-other"), adapters[1].device)
    assert memory.find(str(number)) is None, "another adapter must not be taken for ours"


def test_an_address_that_another_adapter_has_taken_is_not_opened(learnt, adapters):
    memory, number, name = learnt
    point(number, adapters[1].device)
    assert memory.find(str(number)) == str(name), "ours has another number now"
    name.unlink()
    point(name.with_name("usb-Another-if00"), adapters[1].device)
    with pytest.raises(LinkLostError, match=r"ttyUSB0 is now another adapter \(usb-Another-if00\) and was not opened"):
        memory.find(str(number))


async def test_a_pseudo_terminal_whose_number_another_aircraft_got_is_not_written_to():
    first = Adapter()
    device = first.device
    async with linked(device) as (link, _):
        await wait_until(lambda: "b" in first.letters(12) and bool(link.firmware))
        first.unplug()
        await wait_until(lambda: link.condition.value in ("absent", "down"))
        second = Adapter()
        try:
            if second.device != device:
                pytest.skip("another program got the number")
            await wait_until(lambda: bool(second.letters(8)) and link.doubt is not None)
            await asyncio.sleep(0.5)
            assert set(second.letters(8)) == {"v"}
            assert "fc has release 2.08a, before 2.12a" in link.health().state.reason
        finally:
            second.unplug()


def verdict(condition: LinkCondition, cause: VerdictCause = VerdictCause.OTHER) -> HeldFinding:
    """A verdict that has held since 0 s."""
    return HeldFinding(VerdictFinding(condition, "why", cause), 0.0)


def test_every_second_attempt_is_the_configured_rate():
    search = BaudSearch(57600, enabled=True)
    tried = []
    for step in range(6):
        opened = 10.0 * step
        search.reason_to_reopen(verdict(LinkCondition.GARBAGE), opened, opened + SILENT_PATIENCE + GARBAGE_PATIENCE)
        tried.append(search.current)
    assert tried == [115200, 57600, 38400, 57600, 19200, 57600]
    assert search.attempt is not None
    assert search.attempt.condition is LinkCondition.GARBAGE


def test_plain_text_is_no_wrong_line_rate():
    search = BaudSearch(57600, enabled=True)
    assert search.reason_to_reopen(verdict(LinkCondition.GARBAGE, VerdictCause.PLAIN_TEXT), 0.0, 60.0) is None


def test_a_stuck_port_is_opened_anew_at_the_same_rate():
    search = BaudSearch(57600, enabled=False)
    stuck = verdict(LinkCondition.DOWN, VerdictCause.PORT_STUCK)
    assert search.reason_to_reopen(stuck, 0.0, STUCK_PATIENCE) is None
    assert search.reason_to_reopen(stuck, 0.0, STUCK_PATIENCE + 0.01) == "why"
    assert search.current == 57600
