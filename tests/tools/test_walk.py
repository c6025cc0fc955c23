"""A newcomer's walk: what a page lets him type, what is compared, and that its plan speaks of what the pages say."""

from __future__ import annotations

import os
import re
import subprocess

import pytest

from mkdaemon.errors import MkError
from tests.places import ROOT
from tools import walkshell
from tools.walk import README, Walk, clone, plan_of, report
from tools.walkplan import PAGES, Kind, Manner, Page
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
    (tmp_path / "mkdaemon" / "below").mkdir(parents=True)

    def follow(*manners):
        (tmp_path / "mkdaemon" / "page.md").write_text(PAGE)
        walk = Walk(tmp_path, ROOT)
        walk.follow("page.md", Page(manners))
        return walk

    return follow


def test_readme_and_every_tutorial_is_followed_and_every_row_of_the_plan_is_about_something_on_its_page():
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    tutorials = re.findall(r": ([\w-]+\.md)", text.partition("- Tutorials:")[2].partition("- How-to:")[0])
    assert list(PAGES) == [README, *(f"docs/{name}" for name in tutorials)]
    plans = {path: plan_of(ROOT / path, page) for path, page in PAGES.items()}
    assert all(plans.values())
    assert [task.typed for task, _ in plans[README] if not task.is_python] == ["make demo", "make test"]


def test_what_differs_is_noted_with_its_line_and_nothing_else(followed, tmp_path, capsys):
    (tmp_path / "mkdaemon" / "below" / "state").write_text("it flies\n")
    walk = followed(
        Manner(RUNS, Kind.STAYS, "ready"),
        Manner("cat state", Kind.REPEATED, "flies"),
        Manner("flown", Kind.LEFT_OUT, why="there is no aircraft"),
        Manner("print", shows="from python"),
    )
    answer, code = walk.differences
    assert answer == "page.md:12: echo 1\n  the page says:\n    2\n  here it is:\n    1"
    assert code.startswith("page.md:19: cat missing\n  the page says:\n    exit code 0, not 1\n")
    assert walk.left_out == ["page.md:20: flown: there is no aircraft"]
    assert walk.count == 8
    with pytest.raises(MkError, match="2 answers are not those of the pages"):
        report(walk)
    assert f"\n{answer}\n" in capsys.readouterr().out


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
    clone(root, tmp_path)
    assert not (tmp_path / "mkdaemon" / "flight.gpx").exists()
    assert "first" in capsys.readouterr().out
    with pytest.raises(MkError, match="git clone"):
        clone(root, tmp_path)
