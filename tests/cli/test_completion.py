"""Completion by Tab, as bash itself does it."""

from __future__ import annotations

import shutil
import subprocess

import pytest

from mkdaemon.cli.mkctl.commands import ABOUT, COMMANDS
from mkdaemon.cli.program import COMPLETION, build, run

ASK = """
source {script}
COMP_WORDS=({words}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
_mkctl
echo "${{COMPREPLY[@]}}"
"""


def program(commands=COMMANDS):
    return build("mkctl", ABOUT, commands, chosen=COMPLETION)


@pytest.fixture(scope="module")
def script(tmp_path_factory):
    path = tmp_path_factory.mktemp("completion") / "mkctl.bash"
    assert run(program(), [COMPLETION, "--shell", "bash", "--output", str(path)]) == 0
    return path


def completed(script, words):
    shell = shutil.which("bash")
    assert shell is not None, "install bash"
    found = subprocess.run([shell, "-c", ASK.format(script=script, words=words)], capture_output=True, text=True)
    return found.stdout.split()


@pytest.mark.parametrize(
    ("words", "among"),
    [
        ("mkctl ta", {"take-off"}),
        ("mkctl lease ''", {"take", "show"}),
        ("mkctl take-off --ve", {"--vehicle"}),
    ],
)
def test_bash_completes_commands_their_second_words_and_options(script, words, among):
    assert among <= set(completed(script, words))


def test_the_startup_file_is_changed_where_no_other_file_was_asked_for(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert run(program(COMMANDS[:1]), [COMPLETION, "--shell", "bash"]) == 0
    script = tmp_path / ".local" / "share" / "bash-completion" / "completions" / "mkctl"
    assert script.is_file()
    assert str(script) in (tmp_path / ".bashrc").read_text()
    assert "mkctl completes commands" in capsys.readouterr().out


def test_a_file_that_cannot_be_written_is_named(tmp_path, capsys):
    (tmp_path / "file").touch()
    assert run(program(COMMANDS[:1]), [COMPLETION, "--shell", "bash", "--output", str(tmp_path / "file" / "x")]) == 1
    assert "give another file by --output" in capsys.readouterr().err


def test_a_shell_that_is_not_known_is_asked_for(monkeypatch, capsys):
    monkeypatch.setattr("cyclopts.completion.detect.detect_shell", _fail)
    monkeypatch.setattr("cyclopts.core.detect_shell", _fail, raising=False)
    monkeypatch.setattr("cyclopts.completion.install.detect_shell", _fail, raising=False)
    code = run(program(COMMANDS[:1]), [COMPLETION])
    assert (code, "give --shell" in capsys.readouterr().err) == (2, True)


def _fail():
    from cyclopts.completion.detect import ShellDetectionError

    raise ShellDetectionError
