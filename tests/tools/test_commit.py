"""The last commit: its subject, its body, and trees that have none."""

from __future__ import annotations

import subprocess

import pytest

from mkdaemon.cli.program import run
from tools.commit import LONGEST, app, mistakes_of

GOOD = "link: drop setpoints past their deadline\n\nSeen: 3 of 100 were late.\n"


@pytest.mark.parametrize(
    ("message", "wrong"),
    [
        (GOOD, []),
        (GOOD.partition("\n")[0], ["no body"]),
        (GOOD.replace("\n\n", "\n"), ["blank line"]),
        ("Merge things\n\nSeen.", ["area"]),
        ("a: " + LONGEST * "x" + "\n\nSeen.", ["75 characters"]),
        ("a: " + (LONGEST - 3) * "x" + "\n\nSeen.", []),
    ],
)
def test_what_a_message_lacks(message, wrong):
    found = list(mistakes_of(message))
    assert len(found) == len(wrong)
    assert all(words in mistake for words, mistake in zip(wrong, found, strict=True))


def git(folder, *words):
    command = ["git", "-C", str(folder), "-c", "user.name=a", "-c", "user.email=a@b", *words]
    subprocess.run(command, check=True, capture_output=True)


def test_the_last_commit_is_checked_also_of_a_shallow_clone(tmp_path, capsys):
    whole, shallow = tmp_path / "whole", tmp_path / "shallow"
    whole.mkdir()
    git(whole, "init", "--quiet")
    assert run(app, ["--root", str(whole)]) == 0
    git(whole, "commit", "--allow-empty", "--message", "no area")
    assert run(app, ["--root", str(whole)]) == 1
    assert "does not begin with its area" in capsys.readouterr().err
    git(whole, "commit", "--allow-empty", "--message", GOOD)
    git(tmp_path, "clone", "--depth", "1", whole.as_uri(), str(shallow))
    assert run(app, ["--root", str(shallow)]) == 0
    assert "has a subject and a body" in capsys.readouterr().out


def test_a_merge_is_not_checked_also_where_a_shallow_clone_hides_its_parents(tmp_path, capsys):
    whole, shallow = tmp_path / "whole", tmp_path / "shallow"
    whole.mkdir()
    git(whole, "init", "--quiet", "--initial-branch", "one")
    git(whole, "commit", "--allow-empty", "--message", GOOD)
    git(whole, "checkout", "-b", "two")
    git(whole, "commit", "--allow-empty", "--message", GOOD)
    git(whole, "checkout", "one")
    git(whole, "merge", "--no-ff", "two", "--message", "Merge branch 'two'")
    git(tmp_path, "clone", "--depth", "1", whole.as_uri(), str(shallow))
    assert run(app, ["--root", str(whole)]) == run(app, ["--root", str(shallow)]) == 0
    out = capsys.readouterr().out
    assert "has a subject and a body" in out
    assert "no commit to check" in out


def test_a_tree_without_git_passes_and_says_so(tmp_path, capsys):
    assert run(app, ["--root", str(tmp_path)]) == 0
    assert "no git checkout" in capsys.readouterr().out
