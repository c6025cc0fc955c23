"""`python -m tools.commit`: the last commit has a subject `area: what changed` and a body that says what was observed.

Merges are not checked. A copy of the tree without git has no commit to check.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Final

from cyclopts import App, Parameter

from mkdaemon.cli.program import run
from mkdaemon.errors import MkError

LONGEST: Final = 72
"""Characters of a subject: `git log --oneline` shows it whole in a terminal of 80."""
AREA: Final = re.compile(r"[a-z][\w ,./-]*: \S")


def mistakes_of(message: str) -> Iterator[str]:
    """Find what is wrong with the message of a commit."""
    subject, _, rest = message.strip().partition("\n")
    if len(subject) > LONGEST:
        yield f"the subject has {len(subject)} characters, at most {LONGEST} are allowed"
    if not AREA.match(subject):
        yield "the subject does not begin with its area, as in `link: drop setpoints past their deadline`"
    if rest and not rest.startswith("\n"):
        yield "a blank line is missing between subject and body"
    if not rest.strip():
        yield "there is no body: say what was observed"


def last_commit(root: Path) -> tuple[str, str] | None:
    """Read the last commit that is no merge: its short name and its message; None where git has none.

    Args:
        root: of the checkout; a folder inside another checkout is none.
    """
    if not (root / ".git").exists():
        return None
    name = _git(root, "log", "--max-count=1", "--no-merges", "--format=%h").strip()
    head, _, message = _git(root, "cat-file", "commit", name or "HEAD").partition("\n\n")
    is_merge = head.count("\nparent ") > 1  # a shallow clone hides the parents of its oldest commit from the log
    return (name, message) if name and message and not is_merge else None


def _git(root: Path, *words: str) -> str:
    """What git prints; empty where it fails or is not installed."""
    try:
        return subprocess.run(["git", "-C", str(root), *words], capture_output=True, text=True, check=False).stdout
    except FileNotFoundError:
        return ""


def commit(*, root: Annotated[Path, Parameter(help="Root of the source tree.")] = Path()) -> None:
    """Check the message of the last commit.

    Raises:
        MkError: subject or body is not as CONTRIBUTING.md says.
    """
    found = last_commit(root)
    if found is None:
        print("no commit to check: no git checkout, or only a merge is known")
        return
    name, message = found
    wrong = list(mistakes_of(message))
    if wrong:
        msg = f"commit {name}: {'; '.join(wrong)}. CONTRIBUTING.md, Commits; `git commit --amend` changes it"
        raise MkError(msg)
    print(f"commit {name} has a subject and a body")


app = App(name="commit", default_command=commit, default_parameter=Parameter(negative=()))

if __name__ == "__main__":
    sys.exit(run(app))
