"""`python -m tools.walk`: a newcomer's first day, whole: README's two commands, then every tutorial, line by line.

The tree is cloned into a new folder, with a new home and nothing of the developer's environment. Every command of the
pages is typed as it stands there and its answer compared; `tools/walkplan.py` says what runs on and what Ctrl-C ends.
After the first command, which downloads, everything runs without a network, where the machine permits that.
"""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Final, NamedTuple

from cyclopts import App, Parameter

from lab.rigs.walk import Block, answered_steps, blocks_of, is_answer
from mkdaemon.cli.program import run
from mkdaemon.errors import MkError
from tools.walkplan import PAGES, SIMULATOR, Kind, Manner, Page
from tools.walkshell import USER, Terminals, Typed, clean_environment, leave_network

README: Final = "README.md"
HOME: Final = f"/home/{USER}"
"""How a newcomer's home is written on the pages."""
CLIENT: Final = re.compile(rf"\b{USER}-[\w.-]+?-\d+\b")
"""How a client names itself: user, machine, process."""
CLIENT_ON_PAGES: Final = f"{USER}-ground-4711"
RECORDING: Final = re.compile(r"\S+\.mcap")
PORT: Final = re.compile(r"--port (/dev/\S+)")
PYTHON: Final = ".venv/bin/python"
_COMMENT: Final = re.compile(r"\s+# .*$")
_HAPPENS: Final = re.compile(r"# Ctrl-C ends the (\w+)")
_PROGRAMS: Final = {"daemon": "mkdaemon run", "simulator": "mkdaemon sim"}


class Task(NamedTuple):
    """One thing to do on a page.

    Attributes:
        typed: a line, without its comment; of a block of Python, the program.
        whole: the same as it stands on the page.
        answer: lines that the page shows below it; None where it shows none.
        line: number of its line in the page.
        is_python: it is a program.
    """

    typed: str
    whole: str
    answer: list[str] | None = None
    line: int = 0
    is_python: bool = False


def tasks_of(block: Block) -> Iterator[Task]:
    """What a block of a page lets its reader do, in its order."""
    match block.language:
        case "console":
            for step in answered_steps(block):
                yield Task(_COMMENT.sub("", step.typed), step.typed, step.answer, step.line)
        case "sh":
            for number, whole in enumerate(re.sub(r"\\\n *", " ", block.text).splitlines(), block.line):
                yield Task(_COMMENT.sub("", whole), whole, None, number)
        case "python":
            yield Task(block.text, block.text, None, block.line, is_python=True)


def plan_of(path: Path, page: Page) -> list[tuple[Task, Manner]]:
    """What a page lets its reader do, each with how it is carried out.

    Raises:
        MkError: a row of the plan is about nothing on the page.
    """
    tasks = [(task, _manner_of(page, task)) for block in blocks_of(path) for task in tasks_of(block)]
    used = {manner.begins for _, manner in tasks}
    if lost := [manner.begins for manner in page.manners if manner.begins not in used]:
        raise MkError(f"tools/walkplan.py has rows for what {path.name} does not say: {lost}")
    return [*((Task(manner.begins, manner.begins), manner) for manner in page.before), *tasks]


def _manner_of(page: Page, task: Task) -> Manner:
    for manner in page.manners:
        if manner.begins in task.whole if task.is_python else f"{task.whole}\n".startswith(manner.begins):
            return manner
    return Manner(task.typed)


class Walk:
    """A newcomer who follows pages in a clone, and notes what differs.

    Attributes:
        differences: what was another one than on the pages, each with its place.
        left_out: what was not run, or not looked at, and why.
        count: lines carried out.
    """

    def __init__(self, folder: Path, root: Path) -> None:
        """Begin with an empty home.

        Args:
            folder: has the clone; for the home and what is printed.
            root: the developer's tree.
        """
        self.differences: list[str] = []
        self.left_out: list[str] = []
        self.count = 0
        self._tree, self._home, self._root = folder / "mkdaemon", folder / "home", root
        self._outputs = folder / "printed"
        self._home.mkdir()
        self._outputs.mkdir()
        self._stand_ins: dict[str, str] = {}

    def follow(self, path: str, page: Page) -> None:
        """Follow a page to its end.

        Raises:
            MkError: the plan does not fit the page.
        """
        tasks = plan_of(self._tree / path, page)
        outputs = self._outputs / Path(path).stem
        outputs.mkdir()
        terminals = Terminals(self._tree, clean_environment(self._home, self._root), outputs)
        port = next((found[1] for task, _ in tasks if (found := PORT.search(task.typed))), "/dev/pts/N")
        self._stand_ins = {HOME: str(self._home)}
        _print(f"{path}: {len(tasks)} lines")
        try:
            for task, manner in tasks:
                typed = self._carry_out(f"{path}:{task.line}", task, manner, terminals)
                if manner.kind is Kind.STAYS and typed and (found := re.search(SIMULATOR, typed.text)):
                    self._stand_ins[port] = found["port"]
                if path == README and task.typed == "make demo" and not leave_network():
                    self._leave_out(f"{path}: without a network: only root may leave it")
        finally:
            for line, typed in terminals.close().items():
                if typed.wrong:
                    self._note(f"{path}: {line}", "Ctrl-C ends it in order", typed)

    def _carry_out(self, place: str, task: Task, manner: Manner, terminals: Terminals) -> Typed | None:
        shown = f"{place}: {f'a program: {manner.begins}' if task.is_python else task.whole}"
        if manner.why:
            self._leave_out(f"{shown}: {manner.why}")
        if manner.kind is Kind.LEFT_OUT:
            return None
        _print(f"  {shown}")
        self.count += 1
        happening = _HAPPENS.fullmatch(task.whole)
        if happening is not None:
            typed = terminals.interrupt(_PROGRAMS[happening[1]])
        else:
            typed = terminals.type(self._here(self._line_of(task)), manner)
        for expected in self._missing(task if happening is None else task._replace(answer=None), manner, typed):
            self._note(shown, expected, typed)
        if task.answer and "log list" in task.typed:
            on_page, here = RECORDING.findall("\n".join(task.answer)), RECORDING.findall(typed.text)
            if on_page and here:  # the newest stands last
                self._stand_ins[on_page[-1]] = here[-1]
        return typed

    def _line_of(self, task: Task) -> str:
        """What is typed for a task; a program is written to a file first."""
        if not task.is_python:
            return task.typed
        program = self._home / f"program{task.line}.py"
        program.write_text(task.typed, encoding="utf-8")
        return f"{PYTHON} {program}"

    def _missing(self, task: Task, manner: Manner, typed: Typed) -> Iterator[str]:
        """What was expected and did not come."""
        if typed.wrong:
            yield typed.wrong
            return
        # Python itself says so when Ctrl-C ends a program.
        is_interrupted = task.is_python and typed.text.rstrip().endswith("KeyboardInterrupt")
        if "Traceback (most recent call last)" in typed.text and not is_interrupted:
            yield "no traceback"
        if task.answer is not None:
            lines = [line for line in self._there(typed.text).splitlines() if line.strip()]
            if not is_answer([line for line in task.answer if line.strip()], lines):
                yield "\n".join(task.answer)
        elif manner.kind in (Kind.TO_END, Kind.REPEATED) and typed.code is not None:
            if typed.code not in manner.codes:
                yield f"exit code {' or '.join(map(str, manner.codes))}, not {typed.code}"
            if not re.search(manner.shows, typed.text):
                yield f"something like {manner.shows}"

    def _here(self, line: str) -> str:
        for on_page, here in self._stand_ins.items():
            line = line.replace(on_page, here)
        return line

    def _there(self, text: str) -> str:
        for on_page, here in self._stand_ins.items():
            text = text.replace(here, on_page)
        return CLIENT.sub(CLIENT_ON_PAGES, text)

    def _note(self, shown: str, expected: str, typed: Typed) -> None:
        wanted, got = (text.strip().replace("\n", "\n    ") for text in (expected, self._there(typed.text)))
        self.differences.append(f"{shown}\n  the page says:\n    {wanted}\n  here it is:\n    {got}")
        _print(f"       differs: {expected.splitlines()[0]}")

    def _leave_out(self, what: str) -> None:
        self.left_out.append(what)
        _print(f"       not run: {what}")


def _print(words: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {words}", flush=True)


def clone(root: Path, folder: Path) -> None:
    """Clone a tree, as far as it is committed, into a folder.

    Raises:
        MkError: it cannot be cloned.
    """
    _git(folder, "clone", "--quiet", str(root.resolve()), str(folder / "mkdaemon"))
    _print(f"{folder / 'mkdaemon'}: {_git(folder / 'mkdaemon', 'log', '-1', '--format=%h %s')}")
    if changed := _git(root, "status", "--porcelain"):
        _print(f"not in it, for they are not committed: {len(changed.splitlines())} files")


def _git(folder: Path, *words: str) -> str:
    done = subprocess.run(["git", "-C", str(folder), *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise MkError(f"git {' '.join(words)}: {done.stderr.strip()}")
    return done.stdout.strip()


def follow(root: Path, folder: Path, wanted: Sequence[str]) -> Walk:
    """Follow pages in a clone below a folder.

    Args:
        root: of the tree.
        folder: for the clone, the home and what is printed.
        wanted: names of pages; none for all of them, README first.

    Raises:
        MkError: there is no such page, or the plan does not fit one.
    """
    pages = {Path(path).stem: path for path in PAGES}
    if unknown := [name for name in wanted if name not in pages]:
        raise MkError(f"no page {unknown[0]}: there are {', '.join(pages)}")
    clone(root, folder)
    walk = Walk(folder, root.resolve())
    if wanted and Path(README).stem not in wanted:
        _print(f"only {', '.join(wanted)}: README's commands are not run, `make venv` is")
        environment = clean_environment(folder / "home", root.resolve())
        subprocess.run(["make", "venv"], cwd=folder / "mkdaemon", env=environment, check=True)
        if not leave_network():
            walk.left_out.append("everything: without a network: only root may leave it")
    for name in wanted or pages:
        walk.follow(pages[name], PAGES[pages[name]])
    return walk


def report(walk: Walk) -> None:
    """Print what was not run and what differed.

    Raises:
        MkError: something differed.
    """
    print(f"\n{walk.count} lines carried out")
    print(*(f"not run: {one}" for one in walk.left_out), *(f"\n{one}" for one in walk.differences), sep="\n")
    if walk.differences:
        raise MkError(f"{len(walk.differences)} answers are not those of the pages")
    print("every answer is that of its page")


def walk(
    *pages: Annotated[str, Parameter(help="Only these, for example quickstart; README's commands are left out then.")],
    root: Annotated[Path, Parameter(help="Root of the source tree.")] = Path(),
) -> None:
    """Follow README and the tutorials in a new clone, as a newcomer does.

    Raises:
        MkError: an answer is another one than on its page.
    """
    # In the background Ctrl-C is ignored, and every program started from here would ignore it, too.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with tempfile.TemporaryDirectory(prefix="newcomer-") as made:
        report(follow(root, Path(made), pages))


app = App(name="walk", default_command=walk, default_parameter=Parameter(negative=()))

if __name__ == "__main__":
    sys.exit(run(app))
