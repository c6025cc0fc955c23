"""Old names of commands: each is answered with a new one that exists, by one line and exit code 2."""

from __future__ import annotations

import shlex

import pytest

from mkdaemon.cli.mkctl.app import app as mkctl
from mkdaemon.cli.mkdaemon.app import app as mkdaemon
from mkdaemon.cli.program import EXIT_CONFIG, run
from mkdaemon.cli.renamed import RENAMED, new_name

PROGRAMS = {"mkctl": mkctl, "mkdaemon": mkdaemon}
ROWS = [(program, old, new) for program, table in RENAMED.items() for old, new in table.items()]


@pytest.mark.parametrize(("program", "old", "new"), ROWS)
def test_an_old_name_is_answered_with_the_new_one_which_exists_and_nothing_is_done(program, old, new, capsys):
    assert run(PROGRAMS[program], [*shlex.split(old), "--help"]) == EXIT_CONFIG
    told = capsys.readouterr()
    assert told.out == "" and len(told.err.splitlines()) == 1
    assert f"`{program} {old}` is now `" in told.err and new in told.err
    words = shlex.split(new.replace(",", " and ").split(" and ")[0])
    app = PROGRAMS[words.pop(0) if words[0] == "mkdaemon" else program]
    for word in words:
        if not word.startswith("-") and app.default_command is None:
            app = app[word]
    app = PROGRAMS[program]
    *groups, last = shlex.split(old)
    for word in groups:
        if word not in app:
            return
        app = app[word]
    assert last not in app


@pytest.mark.parametrize("words", [["status"], [], ["get", "record"], ["log", "list"], ["log", "record"]])
def test_a_name_that_is_kept_and_an_argument_that_looks_like_an_old_name_are_left_alone(words):
    assert new_name("mkctl", words) is None
