"""The recipes of docs/architecture.md are carried out as they stand there, on a copy of the tree."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.places import ROOT
from tools.docs import FILLED, GENERATED

PAGE = ROOT / "docs" / "architecture.md"
COPIED = ("src", "tests", "tools", "lab", "docs", "configs", "examples", "pyproject.toml", "README.md")
STEP = re.compile(
    r"^In `(?P<path>[^`]+)`, (?P<where>at the end|above|in place of|new file)(?:\s`(?P<anchor>[^`]+)`)?:\n\n```python\n"
    r"(?P<code>.*?)^```$",
    re.DOTALL | re.MULTILINE,
)
PROOF = re.compile(r"^```sh\n(.*?)^```$", re.DOTALL | re.MULTILINE)


@dataclass(frozen=True)
class Recipe:
    """A section `### Add ...`: edits and commands."""

    name: str
    steps: list[re.Match[str]] = field(repr=False)
    commands: list[str] = field(repr=False)

    @property
    def files(self) -> set[str]:
        return {step["path"] for step in self.steps}


def read_recipes() -> list[Recipe]:
    sections = re.split(r"^### (?=Add )", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    return [
        Recipe(
            section.partition("\n")[0],
            list(STEP.finditer(section)),
            [command for block in PROOF.findall(section) for command in block.splitlines()],
        )
        for section in sections
    ]


RECIPES = read_recipes()


def apply(step: re.Match[str], tree: Path) -> None:
    path, code = tree / step["path"], step["code"]
    if step["where"] == "new file":
        assert not path.exists()
        path.write_text(code, encoding="utf-8")
        return
    text = path.read_text(encoding="utf-8")
    if step["where"] == "at the end":
        path.write_text(text.rstrip("\n") + "\n" + code, encoding="utf-8")
        return
    lines = text.splitlines(keepends=True)
    (place,) = (n for n, line in enumerate(lines) if line.startswith(step["anchor"]))
    kept = place if step["where"] == "above" else place + 1
    path.write_text("".join([*lines[:place], code, *lines[kept:]]), encoding="utf-8")


def contents(tree: Path) -> dict[str, bytes]:
    files = (
        path
        for path in tree.rglob("*")
        if path.suffix in {".py", ".md", ".svg", ".toml"} and ".ruff_cache" not in path.parts
    )
    return {path.relative_to(tree).as_posix(): path.read_bytes() for path in files}


PROOFS = """
import contextlib, io, json, sys
import pytest

for words in json.loads(sys.argv[1]):
    with contextlib.redirect_stdout(io.StringIO()) as out:
        code = int(pytest.main(words))
    print(json.dumps([code, out.getvalue()]), flush=True)
"""


def words_of(command: str) -> list[str]:
    """The words of a command, of which an expression behind -k is one."""
    before, is_chosen, expression = command.partition(" -k ")
    return [*shlex.split(before), *(["-k", expression] if is_chosen else [])]


def run(words: Sequence[str], tree: Path, limit: float = 600.0) -> subprocess.CompletedProcess[str]:
    """Run a command in the tree, for as long as the limit at most [s]."""
    environment = {
        **os.environ,
        "PYTHONPATH": f"{tree / 'src'}{os.pathsep}{tree}",
        "PYTEST_ADDOPTS": "-p no:cacheprovider",
        # Hypothesis parses every source of the tree for constants to try, and keeps them by content: once is enough.
        "HYPOTHESIS_STORAGE_DIRECTORY": str(ROOT / ".hypothesis"),
    }
    program = sys.executable if words[0] == "python" else words[0]
    return subprocess.run(
        [program, *words[1:]], cwd=tree, env=environment, capture_output=True, text=True, check=False, timeout=limit
    )


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    """A copy of the tree in which every recipe was carried out; what their common commands change is counted, too."""
    tree = tmp_path_factory.mktemp("recipes")
    for name in COPIED:
        source = ROOT / name
        if source.is_dir():
            ignored = shutil.ignore_patterns("__pycache__", "*.png", "*.jpg")
            shutil.copytree(source, tree / name, ignore=ignored)
        elif source.is_file():
            shutil.copy(source, tree / name)
    before = contents(tree)
    for recipe in RECIPES:
        for step in recipe.steps:
            apply(step, tree)
    for command in dict.fromkeys(command for recipe in RECIPES for command in recipe.commands):
        if not is_own(command):
            assert_done(command, tree)
    changed = {path for path, content in contents(tree).items() if before.get(path) != content}
    assert changed - {*GENERATED, *FILLED} == set().union(*(recipe.files for recipe in RECIPES))
    return tree


def is_own(command: str) -> bool:
    """Whether it is a recipe's own proof, no command that looks at the whole tree."""
    return " pytest " in command


def assert_done(command: str, tree: Path) -> None:
    done = run(words_of(command), tree)
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"


@pytest.fixture(scope="module")
def proofs(tree):
    """Exit code and output of every recipe's own proof, by the command; one process, which imports the tree once."""
    commands = [command for recipe in RECIPES for command in recipe.commands if is_own(command)]
    beginnings = [words_of(command)[:3] for command in commands]
    assert beginnings == [["python", "-m", "pytest"]] * len(commands)
    done = run(["python", "-c", PROOFS, json.dumps([words_of(command)[3:] for command in commands])], tree)
    assert done.returncode == 0, done.stdout + done.stderr
    return dict(zip(commands, map(json.loads, done.stdout.splitlines()), strict=True))


def packages() -> list[str]:
    """Folders of tests of the packages that recipes edit, and the test of closed sets."""
    names = {Path(path).parts[2] for recipe in RECIPES for path in recipe.files if path.startswith("src/")}
    return [*(f"tests/{name}" for name in sorted(names)), "tests/test_closed_sets.py"]


def test_the_page_has_a_recipe_for_everything_that_is_often_added():
    names = ["a message", "a key", "a configuration key", "a verb", "a check", "a manoeuvre", "a campaign"]
    assert [recipe.name for recipe in RECIPES] == [f"Add {name}" for name in names]
    assert all(recipe.steps and recipe.commands for recipe in RECIPES)


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda recipe: recipe.name.replace(" ", "_"))
def test_at_most_four_source_files_are_edited(recipe):
    assert len([path for path in recipe.files if path.startswith("src/")]) <= 4


def test_no_file_is_edited_by_two_recipes_so_that_all_can_be_carried_out_on_one_tree():
    edited = [path for recipe in RECIPES for path in recipe.files]
    assert len(edited) == len(set(edited))


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda recipe: recipe.name.replace(" ", "_"))
def test_a_recipe_does_what_it_promises_and_names_every_file(recipe, proofs):
    own = [command for command in recipe.commands if is_own(command)]
    assert own
    for command in own:
        code, output = proofs[command]
        assert code == 0, f"{command}\n{output}"
        assert re.search(r"\d passed", output), f"{command}\n{output}"


@pytest.mark.whole
def test_with_all_recipes_carried_out_every_test_of_the_packages_they_edit_passes(tree):
    """Seven minutes of a core: `make check-recipes`. Their own proofs alone had left seven tests red."""
    done = run(["python", "-m", "pytest", "-q", "-n", "2", *packages()], tree, limit=7200)
    assert done.returncode == 0, done.stdout + done.stderr
