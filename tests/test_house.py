"""The tree keeps its own rules: links resolve, firmware words stay on wire fields."""

from __future__ import annotations

import ast
import re
import subprocess
import tomllib
from functools import cache
from importlib import metadata

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.places import DOCS, ROOT, SOURCE

PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
SOURCES = sorted((ROOT / "src").rglob("*.py"))


@cache
def tree_of(source):
    """The syntax tree of a file."""
    return ast.parse(source.read_text(encoding="utf-8"))


FIRMWARE_WORDS = re.compile(r"\b(nick|gier|gas_?stick|hoehe|luftdruck|drehzahl)\b", re.IGNORECASE)


def test_every_relative_link_resolves():
    missing = []
    for page in PAGES:
        targets = re.findall(r"\]\((?!https?://|#)([^)#\s]+)", page.read_text(encoding="utf-8"))
        missing += [f"{page.name}: {target}" for target in targets if not (page.parent / target).exists()]
    assert PAGES
    assert missing == []


def anchors_of(page):
    """What a link may point at in a page: its headings, as GitHub names them, and the anchors it sets itself."""
    lines = re.sub(r"^ *```.*?^ *```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    titles = re.findall(r"^#+ (.+)$", lines, re.MULTILINE)
    plain = (re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", title) for title in titles)
    slugs = {re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-") for title in plain}
    return slugs | set(re.findall(r'<a id="([^"]+)"></a>', lines))


def test_every_anchor_of_a_link_exists():
    links = [
        (page, (page.parent / target).resolve() if target else page, anchor)
        for page in PAGES
        for target, anchor in re.findall(r"\]\((?!https?://)([^)#\s]*)#([^)\s]+)\)", page.read_text(encoding="utf-8"))
    ]
    anchors = {target: anchors_of(target) for _, target, _ in links}
    assert links
    assert [
        f"{page.name}: {target.name}#{anchor}" for page, target, anchor in links if anchor not in anchors[target]
    ] == []


CITING = sorted(
    path
    for part in ("src", "lab", "tools", "tests", "examples", "configs")
    for kind in ("*.py", "*.toml")
    for path in (ROOT / part).rglob(kind)
)
CITATION = re.compile(r'docs/((?:lab/)?[\w-]+\.md)((?:(?:,| and) "[^"]+")*)')


def test_every_page_and_section_that_is_cited_exists():
    lost = []
    for path in CITING:
        for name, sections in CITATION.findall(" ".join(path.read_text(encoding="utf-8").split())):
            page = DOCS / name
            titles = (
                re.findall(r"^#+ (?:\d+\. )?(.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
                if page.is_file()
                else ()
            )
            wanted = re.findall(r'"([^"]+)"', sections)
            if not titles or [title for title in wanted if not any(found.startswith(title) for found in titles)]:
                lost.append(f"{path.relative_to(ROOT)}: docs/{name}{sections}")
    assert lost == []


def test_no_work_is_left_for_later():
    left = re.compile(r"\b(TODO|FIXME|XXX)\b")
    assert SOURCES
    assert [source for source in SOURCES if left.search(source.read_text(encoding="utf-8"))] == []


def test_only_one_file_of_each_kind_knows_where_the_repository_is():
    climbing = re.compile(r"Path\(__file__\)\S*\.parent")
    files = [path for folder in ("src", "lab", "tools", "tests") for path in (ROOT / folder).rglob("*.py")]
    offenders = [path for path in files if climbing.search(path.read_text(encoding="utf-8"))]
    assert offenders == [ROOT / "src" / "mkdaemon" / "config" / "reader.py", ROOT / "lab" / "places.py"]


def test_firmware_words_stand_only_where_a_wire_field_is_declared():
    offenders = []
    for source in SOURCES:
        inside = source.relative_to(ROOT / "src")
        if source.is_relative_to(SOURCE / "protocol"):
            continue
        for number, line in enumerate(source.read_text(encoding="utf-8").splitlines(), 1):
            if FIRMWARE_WORDS.search(line) and "mk=" not in line:
                offenders.append(f"{inside}:{number}: {line.strip()}")
    assert offenders == []


def test_letters_of_commands_are_looked_up_in_the_table_of_messages():
    compared = re.compile(
        r"""(spec\.id|letter|\.key) (==|!=) "|^ +case "[A-Za-z]"( |:)|refreshes\("[a-z]"\)""", re.MULTILINE
    )
    rooms = ("link", "daemon", "translate", "control", "bus", "client")
    files = [path for room in rooms for path in sorted((SOURCE / room).rglob("*.py"))]
    assert files
    offenders = [f"{path.name}: {found[0]}" for path in files for found in compared.finditer(path.read_text())]
    assert offenders == []


def test_nothing_names_a_machine_path_or_a_registry_host():
    listing = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listing.returncode:
        pytest.skip("not a git checkout: nothing says which files belong to the tree")
    forbidden = re.compile(
        "|".join(["/" + "work/", "/" + "tmp/", r"pypi" + r"\.org", "python" + "hosted", "npm" + r"js\."])
    )
    offenders = []
    for name in listing.stdout.splitlines():
        path = ROOT / name
        if path.suffix in {".png", ".jpg", ".mcap", ".bin", ".mkraw"} or not path.is_file():
            continue
        if forbidden.search(path.read_text(encoding="utf-8", errors="replace")):
            offenders.append(name)
    assert offenders == []


UNCLEAR = {"said", "told", "begun", "upheld", "helped", "meet", "met", "heard", "tell", "say"}
"""Words that say nothing as a name: what was received, sent or decided has a term in docs/glossary.md."""
PUBLISHED = {"heard_age"}
"""Names on the bus, which clients read."""


def names_in(source):
    """Every name a file gives to a class, function, argument, variable or attribute."""
    for node in ast.walk(tree_of(source)):
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr


def test_names_use_the_terms_of_the_glossary():
    unclear = {name for source in SOURCES for name in names_in(source) if UNCLEAR & set(name.lower().split("_"))}
    assert unclear - PUBLISHED == set()


def test_the_glossary_is_linked_and_names_places_that_exist():
    assert "(docs/glossary.md)" in (ROOT / "README.md").read_text(encoding="utf-8")
    rows = re.findall(
        r"^\| (.+) \| .+ \| `([^`]+)` \|$", (DOCS / "glossary.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    terms = [term for term, _ in rows]
    assert len(rows) > 40
    assert len(set(terms)) == len(terms)
    assert [place for _, place in rows if not (ROOT / place).exists() and not (SOURCE / place).exists()] == []


PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def requirements_of(name, extra):
    """What a distribution needs; for mkdaemon itself the project file counts, not what was installed some time ago."""
    if name == "mkdaemon":
        return [*PROJECT["dependencies"], *PROJECT["optional-dependencies"].get(extra, ())]
    return metadata.requires(name) or ()


def test_everything_that_gets_installed_is_pinned():
    pinned = dict(line.split("==") for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").split())
    wanted, reached = [("mkdaemon", "dev")], {}
    while wanted:
        name, extra = wanted.pop()
        if (canonicalize_name(name), extra) in reached:
            continue
        reached[canonicalize_name(name), extra] = name
        for line in requirements_of(name, extra):
            needed = Requirement(line)
            if needed.marker is None or needed.marker.evaluate({"extra": extra}):
                wanted += [(needed.name, inner) for inner in (needed.extras or {""})]
    names = {name for name, _ in reached} - {"mkdaemon"}
    pins = {canonicalize_name(name): version for name, version in pinned.items()}
    assert {name: metadata.version(name) for name in names} == {name: pins.get(name) for name in names}
    assert set(pins) - names == set(), "pinned, but nothing needs it"


def test_what_builds_the_site_is_pinned_and_leaves_the_other_pins_alone():
    pins = dict(line.split("==") for line in (ROOT / "requirements-docs.txt").read_text(encoding="utf-8").split())
    for line in PROJECT["optional-dependencies"]["docs"]:
        wanted = Requirement(line)
        assert wanted.specifier.contains(pins[wanted.name])
    others = dict(line.split("==") for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").split())
    assert {canonicalize_name(name) for name in pins} & {canonicalize_name(name) for name in others} == set()


def test_public_functions_say_what_they_raise():
    assert [name for source in SOURCES for name in _silent_in(source)] == []


def _silent_in(source):
    """Public functions of a file, each with an exception that it raises and does not name."""
    for function in tree_of(source).body:
        if not isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef) or function.name.startswith("_"):
            continue
        words = ast.get_docstring(function) or ""
        raised = {name for name in _raised_in(function) if name[0].isupper() and name not in words}
        yield from (f"{source.name}: {function.name}: {name}" for name in sorted(raised))


def _raised_in(node):
    """Names of the exceptions raised in a function, those of functions inside it left out."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        if isinstance(child, ast.Raise) and child.exc is not None:
            error = child.exc.func if isinstance(child.exc, ast.Call) else child.exc
            yield error.id if isinstance(error, ast.Name) else "_"
        yield from _raised_in(child)
