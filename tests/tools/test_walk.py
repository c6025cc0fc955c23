"""A newcomer's walk: what a page lets him type, what is compared, and that its plan speaks of what the pages say."""

from __future__ import annotations

import os
import re
import subprocess

import pytest

from mkdaemon.errors import MkError
from tests.places import ROOT
from tools import walkshell
from tools.site import pages_in_navigation
from tools.walk import Walk, clone, report, require_plan_fits, tasks_of
from tools.walkplan import README, TUTORIALS, Kind, Manner, Page
from tools.walkshell import Terminals, clean_environment

PAGE = """# A page

```sh
export WORD=hello          # a variable
cd below
```

```console
$ echo $WORD; pwd | sed 's/.*\\///'
hello
below
$ echo 1
2
```

```sh
sh -c 'echo ready; exec sleep 60'
cat state
cat missing
flown
```

```python
print("from", "python")
```
"""
RUNS = "sh -c"
DEAF = 'trap "exit 9" INT; echo ready; while :; do sleep 0.02; done'


@pytest.fixture
def followed(tmp_path, monkeypatch):
    """Follow a page with these manners; the walk afterwards."""
    monkeypatch.setattr(walkshell, "SETTLING", 0.2)
    monkeypatch.setattr(walkshell, "AGAIN", 0.05)
    monkeypatch.setattr(walkshell, "LOOK", 0.02)
    monkeypatch.setattr("tools.walk.PYTHON", "python3")
    tree = tmp_path / "tree"
    for folder in (tree / "below", tmp_path / "home", tmp_path / "printed"):
        folder.mkdir(parents=True)

    def follow(*manners, page=PAGE):
        (tree / "page.md").write_text(page)
        walk = Walk(tree, tmp_path / "home", tmp_path / "printed", ROOT)
        walk.follow(Page("page.md", manners=manners))
        return walk

    return follow


def test_every_row_of_the_plan_is_about_something_on_its_page():
    for page in (README, *TUTORIALS):
        require_plan_fits(page, tasks_of(ROOT, page), (ROOT / page.path).read_text(encoding="utf-8"))


def test_every_tutorial_is_followed():
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    tutorials = re.findall(r": ([\w-]+\.md)", text.partition("- Tutorials:")[2].partition("- How-to:")[0])
    assert set(tutorials) <= set(pages_in_navigation(ROOT))
    assert [page.path for page in TUTORIALS] == [f"docs/{name}" for name in tutorials]


def test_readme_has_two_commands_and_the_answer_of_the_first():
    first, second = tasks_of(ROOT, README)
    assert (first.typed, second.typed) == ("make demo", "make test")
    assert first.answer[0] == "..."
    assert first.answer[-1] == "landed on the target, motors off"


def test_what_differs_is_noted_with_its_line_and_nothing_else(followed, tmp_path, capsys):
    (tmp_path / "tree" / "below" / "state").write_text("it flies\n")
    walk = followed(
        Manner(RUNS, Kind.STAYS, "ready"),
        Manner("cat state", Kind.REPEATED, "flies"),
        Manner("flown", Kind.LEFT_OUT, why="there is no aircraft"),
        Manner("print", shows="from python"),
    )
    assert [(one.place, one.expected.splitlines()[0]) for one in walk.differences] == [
        ("page.md:12", "2"),
        ("page.md:19", "exit code 0, not 1"),
    ]
    assert walk.left_out == ["page.md:20: flown: there is no aircraft"]
    assert walk.count == 8
    with pytest.raises(MkError, match="2 answers are not those of the pages"):
        report(walk)
    assert "page.md:12: echo 1\n  the page says:\n    2\n  here it is:\n    1\n" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("line", "manner", "wrong"),
    [
        ("sh -c 'echo ready; exec sleep 60'", Manner("sh", Kind.INTERRUPTED, "ready"), ""),
        (f"sh -c '{DEAF}'", Manner("sh", Kind.INTERRUPTED, "ready"), "9 after Ctrl-C"),
        ("head -n 1", Manner("head", Kind.ENTERED), ""),
        ("false", Manner("false", Kind.STAYS, "ready"), "ended by itself with exit code 1"),
        ("sleep 60", Manner("sleep", Kind.STAYS, "ready", patience=0.1), "did not show ready"),
        ("sleep 60", Manner("sleep", patience=0.1), "did not end within 0.1 s"),
        ("echo no", Manner("echo", Kind.REPEATED, "yes", patience=0.1), "never showed yes"),
    ],
)  # fmt: skip
def test_whoever_does_not_show_or_end_as_he_must_is_named(line, manner, wrong, tmp_path, monkeypatch):
    monkeypatch.setattr(walkshell, "SETTLING", 0.2)
    monkeypatch.setattr(walkshell, "LOOK", 0.02)
    (tmp_path / "printed").mkdir()
    terminals = Terminals(tmp_path, os.environ, tmp_path / "printed")
    found = terminals.type(line, manner).wrong
    assert found.endswith(wrong)
    assert bool(found) is bool(wrong)
    assert [ended.wrong for ended in terminals.close().values()] in ([], [""])


def test_a_plan_that_speaks_of_nothing_is_an_error(followed):
    with pytest.raises(MkError, match=r"what page\.md does not say: \['no such line'\]"):
        followed(Manner("no such line"))


def test_a_newcomer_has_nothing_of_the_developer(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", f"{ROOT}/.venv/bin:/usr/bin:/bin")
    monkeypatch.setenv("PYTHONPATH", "src")
    monkeypatch.setenv("MK_CONNECT", "tcp/10.0.0.1:7447")
    monkeypatch.setenv("https_proxy", "http://proxy:1")
    found = clean_environment(tmp_path, ROOT)
    assert found["PATH"] == "/usr/bin:/bin"
    assert found["HOME"] == str(tmp_path)
    assert found["https_proxy"] == "http://proxy:1"
    assert not {"PYTHONPATH", "MK_CONNECT", "VIRTUAL_ENV"} & found.keys()


def test_the_clone_has_what_is_committed(tmp_path, capsys):
    root = tmp_path / "root"
    git = ["git", "-C", str(root), "-c", "user.name=a", "-c", "user.email=a@b"]
    subprocess.run(["git", "init", "--quiet", str(root)], check=True)
    subprocess.run([*git, "commit", "--quiet", "--allow-empty", "--message", "first"], check=True)
    (root / "flight.gpx").touch()
    assert not (clone(root, tmp_path) / "flight.gpx").exists()
    assert "first" in capsys.readouterr().out
    with pytest.raises(MkError, match="git clone"):
        clone(root, tmp_path)
