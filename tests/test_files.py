"""Files that are whole or not there, and folders of a user that has none."""

from __future__ import annotations

import os
import stat
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from mkdaemon.errors import ConfigError, MkError
from mkdaemon.files import saving, user_folder, user_name, write_whole


def test_a_file_that_is_there_is_only_replaced_when_asked_for(tmp_path):
    file = tmp_path / "file"
    write_whole(file, "old")
    with pytest.raises(FileExistsError):
        write_whole(file, "new")
    assert file.read_text() == "old"
    write_whole(file, "new", overwrite=True)
    assert file.read_text() == "new"


def test_a_file_system_without_hard_links_will_do(tmp_path, monkeypatch):
    def refuse(place, fresh):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(Path, "hardlink_to", refuse)
    write_whole(tmp_path / "file", "new")
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("file", "new")]


def test_a_link_stays_and_permissions_are_kept(tmp_path):
    file, link = tmp_path / "file", tmp_path / "link"
    write_whole(file, "old")
    file.chmod(0o600)
    link.symlink_to(file)
    write_whole(link, "new", overwrite=True)
    assert link.is_symlink()
    assert (file.read_text(), file.stat().st_mode & 0o777) == ("new", 0o600)


def test_a_device_is_never_replaced_by_a_file(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(OSError, match="is no file"):
        write_whole(pipe, "new", overwrite=True)
    assert list(tmp_path.iterdir()) == [pipe]


def test_threads_that_write_at_once_leave_the_umask_as_it_was(tmp_path, monkeypatch):
    set_mask = os.umask

    def slow(mask):
        before = set_mask(mask)
        time.sleep(0.001)
        return before

    own = set_mask(0o027)
    monkeypatch.setattr(os, "umask", slow)
    try:
        with ThreadPoolExecutor(4) as pool:
            list(pool.map(lambda number: write_whole(tmp_path / f"{number}", b""), range(16)))
    finally:
        left = set_mask(own)
    assert left == 0o027
    assert {stat.S_IMODE(path.stat().st_mode) for path in tmp_path.iterdir()} == {0o640}


def test_a_file_written_bit_by_bit_gets_its_name_when_it_is_whole(tmp_path):
    path = tmp_path / "a.bin"
    with saving(path) as file:
        file.write(b"one")
        file.write(b"two")
        assert not path.exists()
    assert path.read_bytes() == b"onetwo"

    with pytest.raises(ZeroDivisionError), saving(path, overwrite=True) as file:
        file.write(b"half")
        raise ZeroDivisionError
    assert [one.read_bytes() for one in tmp_path.iterdir()] == [b"onetwo"]


def test_a_file_written_bit_by_bit_replaces_nothing_unasked_and_names_what_is_wrong(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    with pytest.raises(ConfigError, match="--force"), saving(path):
        pass
    with pytest.raises(ConfigError, match="no folder"), saving(tmp_path / "none" / "a.bin"):
        pass
    with pytest.raises(MkError, match=r"a\.bin: cannot be written \(No space left\)"), saving(path, overwrite=True):
        raise OSError(28, "No space left")
    assert [one.read_bytes() for one in tmp_path.iterdir()] == [b"old"]


@pytest.fixture
def homeless(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("HOME", "USER", "LOGNAME", "LNAME", "USERNAME", "XDG_STATE_HOME", "XDG_CONFIG_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("os.getuid", lambda: 12345)


@pytest.mark.usefixtures("homeless")
@pytest.mark.parametrize("variable", ["XDG_STATE_HOME", "XDG_CONFIG_HOME"])
def test_a_user_without_a_home_is_told_what_to_set(variable: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ConfigError, match=f"user 12345 has no home folder; set HOME or {variable}"):
        user_folder(variable)
    assert user_name() == "12345"
    monkeypatch.setenv(variable, "/srv/state")
    assert user_folder(variable) == Path("/srv/state/mkdaemon")
