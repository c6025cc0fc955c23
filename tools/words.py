"""`python -m tools.words`: the pages say one thing by one word, and spell it in British English.

What stands in code, in links and in quotations of other programs (`between backticks`) is not looked at. To refuse a
word, give it a line in `REFUSED`; what a thing is called is in docs/glossary.md.

Phrases of the old dialect (`tools/dialect.toml`) are counted in pages and sources, and may only become fewer.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Final, NamedTuple

from cyclopts import App, Parameter

from mkdaemon.cli.program import run
from mkdaemon.errors import MkError
from tools.site import TABLE, pages_for_users

PAGES: Final = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "docs/**/*.md")
REFUSED: Final[Mapping[str, str]] = {
    # One term for one thing: docs/glossary.md.
    r"baud ?rates?": "baud",
    r"deadman": "dead-man",
    r"drones?|quadcopters?|multicopters?": "aircraft",
    r"fiducials?": "tag",
    r"game pads?": "gamepad",
    r"kill switch(es)?": "gate",
    r"logfiles?": "recording, or log",
    r"set-points?": "setpoint (of a client), set point (of a motor)",
    r"time-stamps?": "time stamp",
    r"way points?": "waypoint",
    # Plain words.
    r"e\.g\.": "for example",
    r"etc\.": "and so on, or the whole list",
    r"i\.e\.": "that is",
    r"leverag(e|es|ed|ing)|utili[sz](e|es|ed|ing)": "use",
    r"obviously|simply|please|needless to say": "nothing: leave it out",
    r"via": "by, through or over",
    r"whilst": "while",
    # Spelling.
    r"behaviors?|behavioral": "behaviour",
    r"can not": "cannot",
    r"centers?|centered|centering": "centre",
    r"colors?|colored|coloring": "colour",
    r"gray": "grey",
    r"licenses?": "licence",
    r"meters?": "metre",
    r"(initial|normal|synchron|optim|recogn|quant|real|minim|maxim|summar)iz(e|es|ed|ing|ation)": "-ise, -isation",
    r"(label|model|travel|cancel|signal)(ed|ing)": "-lled, -lling",
    r"acheiv(e|es|ed|ing)": "achieve",
    r"acomodat(e|es|ed|ing)|accomodat(e|es|ed|ing)": "accommodate",
    r"adress(es|ed)?": "address",
    r"dependant|independant": "dependent, independent",
    r"existant": "existent",
    r"heigths?|hights?": "height",
    r"lenghts?|lenths?": "length",
    r"maintainance": "maintenance",
    r"measurments?": "measurement",
    r"neccessary|necesary": "necessary",
    r"occured|occurence|ocurr(ed|ence)": "occurred, occurrence",
    r"preceed(s|ed|ing)?": "precede",
    r"recie(ve|ves|ved|ver|vers)": "receive, receiver",
    r"refered|refering": "referred, referring",
    r"seperat(e|es|ed|ely|ion)": "separate",
    r"succesful|sucessful|succesfully": "successful",
    r"teh|thier|wich|untill": "the, their, which, until",
    r"widhts?": "width",
}
"""What no page says (a regular expression of whole words), and what it says instead."""
_ALL: Final = re.compile("|".join(rf"(?P<w{n}>\b(?:{word})(?!\w))" for n, word in enumerate(REFUSED)), re.IGNORECASE)
_INSTEAD: Final = tuple(REFUSED.values())
_UNREAD: Final = re.compile(
    r"^ *```.*?^ *```|`[^`\n]*`|\]\([^)\n]*\)|<[^>\n]*>|https?://\S+|\"[^\"\n]*\"", re.DOTALL | re.MULTILINE
)


LONGEST_PAGE: Final = 900
"""Words that a page for a user may have."""
_NOT_COUNTED: Final = re.compile(r"^ *```.*?^ *```|<!-- .*?-->.*?<!-- end.*?-->", re.DOTALL | re.MULTILINE)
"""Code, and tables that are made: what a reader types, compares or looks up."""
_REFERENCE: Final = re.compile(r"^## Reference$.*", re.DOTALL | re.MULTILINE)
"""The end of a page that has its reference below its use."""
DIALECT: Final = "tools/dialect.toml"
COUNTED: Final[Mapping[str, tuple[str, ...]]] = {"docs": PAGES, "src": ("src/**/*.py",)}
"""Where phrases are counted, by the name of the budget."""


class Count(NamedTuple):
    """How often a phrase of the dialect occurs.

    Attributes:
        phrase: its name.
        place: a key of `COUNTED`.
        budget: how often it may.
        found: how often it does.
        instead: what to write.
    """

    phrase: str
    place: str
    budget: int
    found: int
    instead: str


class Found(NamedTuple):
    """A word that is refused.

    Attributes:
        line: number of its line, from 1.
        word: as it stands there.
        instead: what to write.
    """

    line: int
    word: str
    instead: str


def refused_words(text: str) -> Iterator[Found]:
    """Find what a page must not say, in its order."""
    prose = prose_of(text)
    for found in _ALL.finditer(prose):
        number = int((found.lastgroup or "w0")[1:])
        yield Found(prose.count("\n", 0, found.start()) + 1, found[0], _INSTEAD[number])


def prose_of(text: str) -> str:
    """The text of a page with blanks in place of code, links and quotations."""
    return _UNREAD.sub(lambda part: re.sub(r"[^\n]", " ", part[0]), text)


def length_of(text: str) -> int:
    """Number of words of a page to read: without its code, the tables that are made, and its part `## Reference`."""
    read = _NOT_COUNTED.sub(" ", _REFERENCE.sub(" ", text))
    return sum(bool(re.search(r"\w", word)) for word in read.split())


def dialect_counts(root: Path) -> Iterator[Count]:
    """Count every phrase of the dialect in the prose of pages, and in sources as they stand; none without its table."""
    table = root / DIALECT
    if not table.is_file():
        return
    phrases = tomllib.loads(table.read_text(encoding="utf-8"))["phrases"]
    for place, patterns in COUNTED.items():
        texts = [path.read_text(encoding="utf-8") for pattern in patterns for path in root.glob(pattern)]
        whole = "\n".join(map(prose_of, texts) if place == "docs" else texts)
        for name, phrase in phrases.items():
            found = len(re.findall(rf"\b(?:{phrase['words']})\b", whole, re.IGNORECASE))
            yield Count(name, place, phrase[place], found, phrase["instead"])


def lower_budgets(root: Path, counts: Iterable[Count]) -> None:
    """Write the present number of each phrase as its budget; none is raised."""
    present = {(count.phrase, count.place): min(count.budget, count.found) for count in counts}
    lines, phrase = [], ""
    for line in (root / DIALECT).read_text(encoding="utf-8").splitlines():
        phrase = line.split('"')[1] if line.startswith("[") else phrase
        place, _, _ = line.partition(" = ")
        lines.append(f"{place} = {present[phrase, place]}" if (phrase, place) in present else line)
    (root / DIALECT).write_text("\n".join(lines) + "\n", encoding="utf-8")


def words(
    *,
    root: Annotated[Path, Parameter(help="Root of the source tree.")] = Path(),
    lower: Annotated[bool, Parameter(help="Write the present numbers of the dialect's phrases as budgets.")] = False,
) -> None:
    """Check the words of the pages, their length, and that the phrases of the old dialect become fewer.

    Raises:
        MkError: a page says or spells something in another way than the others, is too long, or a phrase became more
            frequent.
    """
    counts = list(dialect_counts(root))
    if lower:
        lower_budgets(root, counts)
    _require_words(root)
    _require_short_pages(root)
    wrong = [
        f"{DIALECT}: `{c.phrase}` stands {c.found} times in {c.place}, {c.budget} are allowed: write {c.instead}"
        for c in counts
        if c.found > c.budget
    ]
    if wrong:
        print("\n".join(wrong))
        msg = f"phrases of the dialect that became more frequent: {len(wrong)}"
        raise MkError(msg)
    left = {place: sum(c.found for c in counts if c.place == place) for place in COUNTED}
    print(f"phrases of the old dialect: {', '.join(f'{found} in {place}' for place, found in left.items())}")
    if any(c.found < c.budget for c in counts) and not lower:
        print("fewer than allowed: `python -m tools.words --lower` writes the present numbers")


def _require_words(root: Path) -> None:
    """Check the words of the pages.

    Raises:
        MkError: a page says or spells something in another way than the others.
    """
    pages = [page for pattern in PAGES for page in sorted(root.glob(pattern))]
    found = [
        f"{page.relative_to(root)}:{found.line}: `{found.word}`: write {found.instead}"
        for page in pages
        for found in refused_words(page.read_text(encoding="utf-8"))
    ]
    if found:
        print("\n".join(found))
        msg = f"words that the pages do not use: {len(found)}; tools/words.py has the list"
        raise MkError(msg)
    print(f"{len(pages)} pages use the words of the list")


def _require_short_pages(root: Path) -> None:
    """Check the length of the pages for users; a tree without a navigation has none.

    Raises:
        MkError: one has too many words.
    """
    if not (root / TABLE).is_file():
        return
    lengths = {page: length_of((root / page).read_text(encoding="utf-8")) for page in pages_for_users(root)}
    long = [f"{page}: {length} words" for page, length in lengths.items() if length > LONGEST_PAGE]
    if long:
        print("\n".join(long))
        msg = f"pages for users with more than {LONGEST_PAGE} words: {len(long)}"
        raise MkError(msg)
    print(f"{len(lengths)} pages for users have at most {max(lengths.values(), default=0)} words")


app = App(name="words", default_command=words, default_parameter=Parameter(negative=()))

if __name__ == "__main__":
    sys.exit(run(app))
