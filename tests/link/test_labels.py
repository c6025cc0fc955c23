"""Labels: read once a firmware, kept in a file, never asked for again."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from lab.rigs.linkrig import Rig, flight_ctrl, navi_ctrl, on_line, rig, virtually
from mkdaemon.link import labels
from mkdaemon.link.labels import LABELS, LabelCache, cache_key, read_labels
from mkdaemon.link.procedures import SilentObserver
from mkdaemon.protocol.dialect import Dialect, Release
from mkdaemon.protocol.wire import Board

NAMES = tuple(f"channel {n}" for n in range(LABELS))


def asked(r: Rig) -> int:
    return sum(s.message is not None and s.message.spec.id == "a" for s in r.log.tx)


@pytest.mark.parametrize(("make", "board"), [(flight_ctrl(), Board.FC), (navi_ctrl(), Board.NC)], ids=["fc", "nc"])
@virtually
async def test_labels_are_read_once_and_kept(make, board, tmp_path):
    path = tmp_path / "state" / "labels.json"
    cache = LabelCache(path)
    async with rig(make) as r:
        await r.until_up()
        first = await read_labels(r.link, board, cache, SilentObserver())
        assert len(first) == LABELS
        assert any("AngleNick" in name or "Angle" in name for name in first)
        assert asked(r) == LABELS
        assert await read_labels(r.link, board, cache, SilentObserver()) == first
        assert asked(r) == LABELS
    cache = LabelCache(path)
    async with rig(make) as r:
        await r.until_up()
        assert await read_labels(r.link, board, cache, SilentObserver()) == first
        assert asked(r) == 0


@on_line(navi_ctrl(), rates={"osd": 100, "attitude": 50}, echo_hz=10)
async def test_reading_labels_delays_nothing_else(r):
    await read_labels(r.link, Board.NC, LabelCache(None), SilentObserver())
    health = r.link.health()
    assert health.echo.lost == 0
    assert not any(kind.is_stale for kind in health.kinds)


def test_the_key_is_board_release_and_checksum():
    fc = Dialect(fc_release=Release(2, 12, 0), nc_release=Release(0, 24, 0), label_checksum=0xBA)
    assert cache_key(Board.FC, fc) == "fc 2.12a 0xba"
    assert cache_key(Board.NC, fc) == "nc 0.24a"
    assert cache_key(Board.MAG, fc) is None
    assert cache_key(Board.FC, Dialect(fc_release=Release(2, 8, 0), label_checksum=3)) == "fc 2.08a"


@pytest.mark.parametrize("content", ["", "not json", "[1, 2]", '{"fc 2.12a": ["too", "few"]}'])
def test_a_broken_file_is_an_empty_cache(content: str, tmp_path: Path):
    path = tmp_path / "labels.json"
    path.write_text(content)
    cache = LabelCache(path)
    assert cache.find("fc 2.12a") is None
    cache.keep("fc 2.12a", NAMES)
    assert LabelCache(path).find("fc 2.12a") == NAMES


def test_a_file_that_cannot_be_written_is_no_failure(tmp_path: Path):
    (tmp_path / "file").write_text("")
    cache = LabelCache(tmp_path / "file" / "labels.json")
    cache.keep("fc", NAMES)
    assert cache.find("fc") == NAMES


async def test_labels_of_a_board_whose_firmware_is_unknown_are_not_kept(monkeypatch):
    async def read(*_, **__):
        return NAMES

    monkeypatch.setattr(labels, "run_procedure", read)
    cache = LabelCache(None)
    link = SimpleNamespace(dialect=Dialect())
    assert await read_labels(link, Board.FC, cache, SilentObserver()) == NAMES
    assert cache.find_for(Board.FC, Dialect(fc_release=Release(2, 12, 0))) is None
    assert cache._known == {}
