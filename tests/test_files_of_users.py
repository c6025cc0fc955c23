"""Folders of a user that has none: a container run with `--user`."""

from __future__ import annotations

from pathlib import Path

import pytest

from mkdaemon.errors import ConfigError
from mkdaemon.files import user_folder, user_name


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
