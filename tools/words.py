"""`python -m tools.words`: the pages say one thing by one word, and spell it in British English.

What stands in code, in links and in quotations of other programs (`between backticks`) is not looked at. To refuse a
word, give it a line in `REFUSED`; what a thing is called is in docs/glossary.md. Phrases of the project's old dialect
(`DIALECT`) are refused in the sources of the product, too.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping
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
DIALECT: Final[Mapping[str, str]] = {
    r"nobody": "no client, no board: name what is missing",
    r"told": "reported, logged, known: say who reports it",
    r"so (?:many|long|far|much|often|few)": 'a number with its unit, or "up to"',
    r"anew": "again, or restart",
    r"the eyes": "vision",
    r"of (?:its|their|his|our) own": "own, before the noun, or separate",
    r"who(?:ever)? (?:flies|flew|holds|asks|reads|sends|hears|speaks|waits)": (
        "the client that, the holder, the pilot in command"
    ),
    r"lets? go|letting go": "release",
    r"by machine": "automatic",
    r"comes? and goe?s?": "intermittent",
    r"(?:is|are|was|were) believed": "is used, is estimated",
    r"stands? in the way": "prevents",
    r"whoever": "the client that, the caller, the holder",
    r"(?:some|any|every)body": "a client, a program, the pilot: name who acts",
}
"""The same of the old dialect."""
_UNREAD: Final = re.compile(
    r"^ *```.*?^ *```|`[^`\n]*`|\]\([^)\n]*\)|<[^>\n]*>|https?://\S+|\"[^\"\n]*\"", re.DOTALL | re.MULTILINE
)


LONGEST_PAGE: Final = 900
"""Words that a page for a user may have."""
_NOT_COUNTED: Final = re.compile(r"^ *```.*?^ *```|<!-- .*?-->.*?<!-- end.*?-->", re.DOTALL | re.MULTILINE)
"""Code, and tables that are made: what a reader types, compares or looks up."""
_REFERENCE: Final = re.compile(r"^## Reference$.*", re.DOTALL | re.MULTILINE)
"""The end of a page that has its reference below its use."""


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


def refused_words(text: str, words: Mapping[str, str]) -> Iterator[Found]:
    """Find what a text must not say, in its order."""
    every = re.compile("|".join(rf"(?P<w{n}>\b(?:{word})(?!\w))" for n, word in enumerate(words)), re.IGNORECASE)
    for found in every.finditer(text):
        number = int((found.lastgroup or "w0")[1:])
        yield Found(text.count("\n", 0, found.start()) + 1, found[0], list(words.values())[number])


def prose_of(text: str) -> str:
    """The text of a page with blanks in place of code, links and quotations."""
    return _UNREAD.sub(lambda part: re.sub(r"[^\n]", " ", part[0]), text)


def length_of(text: str) -> int:
    """Number of words of a page to read: without its code, the tables that are made, and its part `## Reference`."""
    read = _NOT_COUNTED.sub(" ", _REFERENCE.sub(" ", text))
    return sum(bool(re.search(r"\w", word)) for word in read.split())


def words(*, root: Annotated[Path, Parameter(help="Root of the source tree.")] = Path()) -> None:
    """Check the words of pages and sources, and the length of pages.

    Raises:
        MkError: a page says or spells something in another way than the others, or is too long; or a source uses a
            phrase of the old dialect.
    """
    pages = [page for pattern in PAGES for page in sorted(root.glob(pattern))]
    texts: list[tuple[Path, str, Mapping[str, str]]]
    texts = [(page, prose_of(page.read_text(encoding="utf-8")), {**REFUSED, **DIALECT}) for page in pages]
    texts += [(file, file.read_text(encoding="utf-8"), DIALECT) for file in sorted(root.glob("src/**/*.py"))]
    found = [
        f"{path.relative_to(root)}:{found.line}: `{found.word}`: write {found.instead}"
        for path, text, refused in texts
        for found in refused_words(text, refused)
    ]
    if found:
        print("\n".join(found))
        msg = f"words that are not used: {len(found)}; tools/words.py has the list"
        raise MkError(msg)
    print(f"{len(pages)} pages use the words of the list")
    _require_short_pages(root)


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
