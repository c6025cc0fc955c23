"""Every command that a page lets its reader type exists, with these options; nothing of it is run here."""

from __future__ import annotations

import re
import shlex
import shutil

import pytest

from lab.rigs.walk import is_answer, steps_of
from mkdaemon.cli.mkctl.app import app as mkctl
from mkdaemon.cli.mkctl.app import move_behind_command
from mkdaemon.cli.mkctl.commands import GROUPS
from mkdaemon.cli.mkdaemon.app import app as mkdaemon
from mkdaemon.cli.program import run
from tests.places import DATA, DOCS, ROOT

PROGRAMS = {"mkctl": mkctl, "mkdaemon": mkdaemon}
PAGES = sorted([ROOT / "README.md", *DOCS.glob("*.md")])
BLOCK = re.compile(r"^ *```(\w*)\n(.*?)^ *```", re.DOTALL | re.MULTILINE)
CALL = re.compile(r"(\$ )?[\w./]*mk(ctl|daemon) ")
SHORTENED = ("…", "...")
"""Stand for words that are the reader's own."""


def commands_of(page):
    """The programs of ours that a page calls, each with its words."""
    text = page.read_text(encoding="utf-8")
    typed = "".join(block for language, block in BLOCK.findall(text) if language in ("sh", ""))
    for line in typed.replace("\\\n", " ").splitlines():
        if CALL.match(line):
            program, *words = shlex.split(line.removeprefix("$ "), comments=True)
            yield program.rpartition("/")[2], [word for word in words if word not in SHORTENED]


def test_every_command_of_a_page_exists_with_its_options():
    wrong, count = [], 0
    for page in PAGES:
        for program, words in commands_of(page):
            tokens = move_behind_command(words, GROUPS) if program == "mkctl" else words
            count += 1
            try:
                PROGRAMS[program].parse_args(tokens, exit_on_error=False, print_error=False)
            except Exception as error:  # noqa: BLE001  # whatever is wrong with it is told with its page
                wrong.append(f"{page.name}: {program} {shlex.join(words)}: {error}")
    assert count > 100
    assert wrong == []


def leaves(program, words=()):
    """Every command that can be typed: its words, and what its help says."""
    below = [name for name in program if not name.startswith("-")]
    if program.default_command is not None:
        yield words, program.default_command.__doc__
    for name in below:
        yield from leaves(program[name], (*words, name))


@pytest.mark.parametrize("name", PROGRAMS)
def test_the_help_of_every_command_has_an_example_that_can_be_typed(name):
    wrong = []
    commands = dict(leaves(PROGRAMS[name]))
    for words, about in commands.items():
        example = re.search(r"^ *Examples?:\s+(mk(?:ctl|daemon) .*)", about, re.MULTILINE)
        if example is None:
            wrong.append(f"{name} {' '.join(words)}: no example")
            continue
        program, *typed = shlex.split(example[1].strip("`"))
        try:
            PROGRAMS[program].parse_args(typed, exit_on_error=False, print_error=False)
        except Exception as error:  # noqa: BLE001  # whatever is wrong with it is told with its command
            wrong.append(f"{example[1]}: {error}")
        if (program, *typed[: len(words)]) != (name, *words):
            wrong.append(f"{name} {' '.join(words)}: shows {example[1]}")
    assert len(commands) > 20
    assert wrong == []


def test_every_answer_about_a_recording_is_that_of_its_page(tmp_path, monkeypatch, capsys):
    shutil.copy(DATA / "recordings" / "fc_over_target.mcap", tmp_path / "flight.mcap")
    for folder in ("tests", "configs"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    monkeypatch.chdir(tmp_path)
    steps = list(steps_of(DOCS / "record-and-look.md"))
    assert len(steps) == 6
    for step in steps:
        program, *words = shlex.split(step.typed)
        capsys.readouterr()
        assert run(PROGRAMS[program], words) == 0
        lines = [line for line in capsys.readouterr().out.splitlines() if line.strip()]
        assert is_answer(step.answer, lines), "\n".join([step.typed, *lines])
