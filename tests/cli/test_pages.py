"""Every command that a page lets its reader type exists, with these options; nothing of it is run here."""

from __future__ import annotations

import re
import shlex
import shutil

from lab.rigs.walk import is_answer, steps_of
from mkdaemon.cli.mkctl.app import COMMANDS, move_behind_command
from mkdaemon.cli.mkctl.app import app as mkctl
from mkdaemon.cli.mkdaemon.app import app as mkdaemon
from mkdaemon.cli.program import run
from tests.places import DATA, DOCS, ROOT

PROGRAMS = {"mkctl": mkctl, "mkdaemon": mkdaemon}
PAGES = sorted([ROOT / "README.md", *DOCS.glob("*.md")])
BLOCK = re.compile(r"^ *```(\w*)\n(.*?)^ *```", re.DOTALL | re.MULTILINE)
TWO_WORDS = {entry.name for entry in COMMANDS if entry.target.endswith(":app")}
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
            tokens = move_behind_command(words, TWO_WORDS) if program == "mkctl" else words
            count += 1
            try:
                PROGRAMS[program].parse_args(tokens, exit_on_error=False, print_error=False)
            except Exception as error:  # noqa: BLE001  # whatever is wrong with it is told with its page
                wrong.append(f"{page.name}: {program} {shlex.join(words)}: {error}")
    assert count > 100
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
