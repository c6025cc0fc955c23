"""`python -m tools.walk`: a newcomer's first day, whole: README's two commands, then every tutorial, line by line.

The tree is cloned into a new folder, with a new home and nothing of the developer's environment. Every command of the
pages is typed as it stands there and its answer compared; `tools/walkplan.py` says what runs on and what Ctrl-C ends.
After the first command, which downloads, everything runs without a network, where the machine permits that.
"""

from __future__ import annotations

import re
import signal
import socket
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
from tools.walkplan import README, SIMULATOR, TUTORIALS, Kind, Manner, Page
from tools.walkshell import USER, Printed, Terminals, clean_environment, leave_network

BUS: Final = ("127.0.0.1", 7447)
"""Where the daemon of the pages listens."""
HOME: Final = f"/home/{USER}"
"""How a newcomer's home is written on the pages."""
CLIENT: Final = re.compile(rf"\b{USER}-[\w.-]+?-\d+\b")
"""How a client names itself: user, machine, process."""
CLIENT_ON_PAGES: Final = f"{USER}-ground-4711"
RECORDING: Final = re.compile(r"\S+\.mcap")
PORT: Final = re.compile(r"--port (/dev/\S+)")
PORT_OF_PAGES: Final = "/dev/pts/N"
"""What stands for the port of the simulator where no block of the page names one."""
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
    answer: list[str] | None
    line: int
    is_python: bool = False


class Difference(NamedTuple):
    """What was another one than on the page.

    Attributes:
        place: page and line.
        typed: what was typed.
        expected: what the page says.
        got: what came.
    """

    place: str
    typed: str
    expected: str
    got: str


def tasks_of(root: Path, page: Page) -> list[Task]:
    """What a page lets its reader do, in its order.

    Raises:
        MkError: an answer of the plan stands nowhere on the page.
    """
    blocks = list(_blocks_of(root / page.path, page.section))
    tasks = [task for block in blocks for task in _tasks_in(block)]
    for begins, answer in page.answers.items():
        shown = [block.text.splitlines() for block in blocks if not block.language and block.text.startswith(answer)]
        if len(shown) != 1:
            msg = f"{page.path}: no answer begins with {answer}, or several do"
            raise MkError(msg)
        tasks = [task._replace(answer=["...", *shown[0]]) if task.typed == begins else task for task in tasks]
    return tasks


def _blocks_of(path: Path, section: str) -> Iterator[Block]:
    lines = path.read_text(encoding="utf-8").splitlines()
    first = lines.index(f"## {section}") if section else 0
    last = next((n for n in range(first + 1, len(lines)) if section and lines[n].startswith("## ")), len(lines))
    yield from (block for block in blocks_of(path) if first < block.line <= last)


def _tasks_in(block: Block) -> Iterator[Task]:
    match block.language:
        case "console":
            for step in answered_steps(block):
                yield Task(_COMMENT.sub("", step.typed), step.typed, step.answer, step.line)
        case "sh":
            number = block.line
            for whole in re.sub(r"\\\n *", " ", block.text).splitlines():
                yield Task(_COMMENT.sub("", whole), whole, None, number)
                number += 1
        case "python":
            yield Task(block.text, block.text, None, block.line, is_python=True)


def manner_of(page: Page, task: Task) -> Manner:
    """How a task is carried out."""
    for manner in page.manners:
        if manner.begins in task.whole if task.is_python else f"{task.whole}\n".startswith(manner.begins):
            return manner
    return Manner(task.typed)


def require_plan_fits(page: Page, tasks: Sequence[Task], text: str) -> None:
    """Pass where every row of the plan is about something on its page.

    Raises:
        MkError: a row is about nothing.
    """
    used = {manner_of(page, task).begins for task in tasks}
    lost = [manner.begins for manner in page.manners if manner.begins not in used]
    lost += [
        manner.begins for manner in page.before if not page.stands_for and manner.begins not in text.replace("\n", " ")
    ]
    if lost:
        msg = f"tools/walkplan.py has rows for what {page.path} does not say: {lost}"
        raise MkError(msg)


class Walk:
    """A newcomer who follows pages in a clone, and notes what differs.

    Attributes:
        differences: what was another one than on the pages.
        left_out: what was not run, or not looked at, and why.
        count: lines carried out.
    """

    def __init__(self, tree: Path, home: Path, outputs: Path, root: Path) -> None:
        self.differences: list[Difference] = []
        self.left_out: list[str] = []
        self.count = 0
        self._tree, self._home, self._outputs, self._root = tree, home, outputs, root
        self._stand_ins: dict[str, str] = {}
        self._port = ""

    def follow(self, page: Page) -> None:
        """Follow a page to its end.

        Raises:
            MkError: the plan does not fit the page.
        """
        tasks = tasks_of(self._tree, page)
        require_plan_fits(page, tasks, (self._tree / page.path).read_text(encoding="utf-8"))
        outputs = self._outputs / Path(page.path).stem
        outputs.mkdir()
        terminals = Terminals(self._tree, clean_environment(self._home, self._root), outputs)
        self._stand_ins = {HOME: str(self._home)}
        self._port = next((found[1] for task in tasks if (found := PORT.search(task.typed))), PORT_OF_PAGES)
        _tell(f"{page.path}: {len(tasks)} lines")
        if page.stands_for:
            self._leave_out(page.path, page.stands_for, "no such thing here")
        try:
            for manner in page.before:
                self._carry_out(page, Task(manner.begins, manner.begins, None, 0), manner, terminals)
            for task in tasks:
                self._carry_out(page, task, manner_of(page, task), terminals)
                if page is README and task.typed == "make demo" and not leave_network():
                    self._leave_out(page.path, "without a network", "only root may leave it")
        finally:
            for line, ended in terminals.close().items():
                if ended.wrong:
                    self._note(page, Task(line, line, None, 0), "Ctrl-C ends it in order", ended)

    def _carry_out(self, page: Page, task: Task, manner: Manner, terminals: Terminals) -> None:
        shown = task.whole if not task.is_python else f"a program: {manner.begins}"
        place = f"{page.path}:{task.line}"
        if manner.kind is Kind.LEFT_OUT:
            self._leave_out(place, shown, manner.why)
            return
        _tell(f"  {task.line:4} {shown}")
        if happening := _HAPPENS.fullmatch(task.whole):
            printed = terminals.interrupt(_PROGRAMS[happening[1]])
        else:
            printed = terminals.type(self._here(self._line_of(task)), manner)
        self.count += 1
        _tell(f"       {printed.seconds:.1f} s")
        if manner.why:
            self._leave_out(place, shown, manner.why)
        for expected in self._missing(task, manner, printed):
            self._note(page, task, expected, printed)
        self._learn(task, manner, printed)

    def _line_of(self, task: Task) -> str:
        """What is typed for a task; a program is written to a file first."""
        if not task.is_python:
            return task.typed
        program = self._home / f"program{task.line}.py"
        program.write_text(task.typed, encoding="utf-8")
        return f"{PYTHON} {program}"

    def _missing(self, task: Task, manner: Manner, printed: Printed) -> Iterator[str]:
        """What was expected and did not come."""
        if printed.wrong:
            yield printed.wrong
            return
        # Python itself says so when Ctrl-C ends a program.
        is_python_told = task.is_python and printed.text.rstrip().endswith("KeyboardInterrupt")
        if "Traceback (most recent call last)" in printed.text and not is_python_told:
            yield "no traceback"
        if task.answer is not None and not _HAPPENS.fullmatch(task.whole):
            lines = [line for line in self._there(printed.text).splitlines() if line.strip()]
            if not is_answer([line for line in task.answer if line.strip()], lines):
                yield "\n".join(task.answer)
        elif manner.kind in (Kind.TO_END, Kind.REPEATED):
            if printed.code not in manner.codes:
                yield f"exit code {' or '.join(map(str, manner.codes))}, not {printed.code}"
            if not re.search(manner.shows, printed.text):
                yield f"something like {manner.shows}"

    def _learn(self, task: Task, manner: Manner, printed: Printed) -> None:
        """Note what stands on the pages for something that has another name here."""
        if manner.kind is Kind.STAYS and (found := re.search(SIMULATOR, printed.text)):
            self._stand_ins[self._port] = found["port"]
        if task.answer and "log list" in task.typed:
            on_page, here = RECORDING.findall("\n".join(task.answer)), RECORDING.findall(printed.text)
            if on_page and here:  # the newest stands last
                self._stand_ins[on_page[-1]] = here[-1]

    def _here(self, line: str) -> str:
        for on_page, here in self._stand_ins.items():
            line = line.replace(on_page, here)
        return line

    def _there(self, text: str) -> str:
        for on_page, here in self._stand_ins.items():
            text = text.replace(here, on_page)
        return CLIENT.sub(CLIENT_ON_PAGES, text)

    def _note(self, page: Page, task: Task, expected: str, printed: Printed) -> None:
        got = self._there(printed.text).strip()
        self.differences.append(Difference(f"{page.path}:{task.line}", task.whole, expected, got))
        _tell(f"       differs: {expected.splitlines()[0]}")

    def _leave_out(self, place: str, what: str, why: str) -> None:
        self.left_out.append(f"{place}: {what}: {why}")
        _tell(f"       not run: {what}: {why}")


def _tell(words: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {words}", flush=True)


def clone(root: Path, folder: Path) -> Path:
    """Clone a tree, as far as it is committed, into a folder; returns the clone.

    Raises:
        MkError: it cannot be cloned.
    """
    tree = folder / "mkdaemon"
    _git(folder, "clone", "--quiet", str(root.resolve()), str(tree))
    _tell(f"{tree}: {_git(tree, 'log', '-1', '--format=%h %s')}")
    if changed := _git(root, "status", "--porcelain"):
        _tell(f"not in it, for they are not committed: {len(changed.splitlines())} files")
    return tree


def _git(folder: Path, *words: str) -> str:
    done = subprocess.run(["git", "-C", str(folder), *words], capture_output=True, text=True, check=False)
    if done.returncode:
        msg = f"git {' '.join(words)}: {done.stderr.strip()}"
        raise MkError(msg)
    return done.stdout.strip()


def require_free_bus() -> None:
    """Pass where no daemon listens where that of the pages will.

    Raises:
        MkError: one does.
    """
    with socket.socket() as caller:
        if caller.connect_ex(BUS) == 0:
            msg = f"{BUS[0]}:{BUS[1]} is in use: end the daemon that runs here, or follow the pages as root"
            raise MkError(msg)


def follow(root: Path, folder: Path, wanted: Sequence[str]) -> Walk:
    """Follow pages in a clone below a folder.

    Args:
        root: of the tree.
        folder: for the clone, the home and what is printed.
        wanted: names of pages; none for all of them, README first.

    Raises:
        MkError: there is no such page, or the plan does not fit one.
    """
    pages = {Path(page.path).stem: page for page in (README, *TUTORIALS)}
    if unknown := [name for name in wanted if name not in pages]:
        msg = f"no page {unknown[0]}: there are {', '.join(pages)}"
        raise MkError(msg)
    tree, home, outputs = clone(root, folder), folder / "home", folder / "printed"
    home.mkdir()
    outputs.mkdir()
    walk = Walk(tree, home, outputs, root.resolve())
    if wanted and README.path not in [pages[name].path for name in wanted]:
        _tell(f"only {', '.join(wanted)}: README's commands are not run, `make venv` is")
        subprocess.run(["make", "venv"], cwd=tree, env=clean_environment(home, root.resolve()), check=True)
        if not leave_network():
            walk.left_out.append("everything: without a network: only root may leave it")
    for name in wanted or pages:
        if name != Path(README.path).stem:
            require_free_bus()
        walk.follow(pages[name])
    return walk


def report(walk: Walk) -> None:
    """Print what was not run and what differed.

    Raises:
        MkError: something differed.
    """
    print(f"\n{walk.count} lines carried out")
    for one in walk.left_out:
        print(f"not run: {one}")
    for difference in walk.differences:
        print(f"\n{difference.place}: {difference.typed}")
        print("  the page says:", *difference.expected.splitlines(), sep="\n    ")
        print("  here it is:", *difference.got.splitlines(), sep="\n    ")
    if walk.differences:
        msg = f"{len(walk.differences)} answers are not those of the pages"
        raise MkError(msg)
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
