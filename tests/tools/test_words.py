"""Pages say one thing by one word; code, links and quotations are not read."""

from __future__ import annotations

import pytest

from mkdaemon.cli.program import run
from tests.places import ROOT
from tools.words import LONGEST_PAGE, REFUSED, app, length_of, refused_words


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("The drone hovers.", [(1, "drone", "aircraft")]),
        ("One\nColor of\ntwo Drones.", [(2, "Color", "colour"), (3, "Drones", "aircraft")]),
        ("Dronework, the colour, a parameter and a lens.", []),
        ("It is `gray8`, [here](color.md) or <color>, as in https://center.example.", []),
        ('A "license" is quoted.\n```sh\nseperate\n```\nThe end.', []),
        ("First.\n```sh\nx\n```\nIt can not end.", [(5, "can not", "cannot")]),
        ("Use it, e.g. so.", [(1, "e.g.", "for example")]),
    ],
)
def test_a_word_is_found_where_a_reader_reads_it(text, found):
    assert [tuple(one) for one in refused_words(text)] == found


def test_what_is_to_be_written_is_not_refused_itself():
    for instead in REFUSED.values():
        assert list(refused_words(instead)) == []


def test_a_page_with_another_word_is_named_with_its_line(capsys, tmp_path):
    page = tmp_path / "README.md"
    page.write_text("# A\n\nThe drone.\n", encoding="utf-8")
    assert run(app, ["--root", str(tmp_path)]) == 1
    out, err = capsys.readouterr()
    assert out == "README.md:3: `drone`: write aircraft\n"
    assert "pages do not use: 1;" in err
    page.write_text("# A\n\nThe aircraft.\n", encoding="utf-8")
    assert run(app, ["--root", str(tmp_path)]) == 0


TABLE = """# Phrases.

[phrases."let go"]
words = 'lets? go'
instead = 'release'
docs = 2
src = 1
"""


def tree(folder, page, source):
    """A source tree of one page and one module."""
    for below in ("tools", "src"):
        (folder / below).mkdir(exist_ok=True)
    (folder / "tools" / "dialect.toml").write_text(TABLE, encoding="utf-8")
    (folder / "README.md").write_text(page, encoding="utf-8")
    (folder / "src" / "a.py").write_text(source, encoding="utf-8")
    return ["--root", str(folder)]


def test_a_phrase_of_the_dialect_may_only_become_rarer(capsys, tmp_path):
    root = tree(tmp_path, "It lets go. `let go` is code. They let go.\n", '"""It lets go."""\n')
    assert run(app, root) == 0
    assert "2 in docs, 1 in src" in capsys.readouterr().out
    root = tree(tmp_path, "It lets go.\n", '"""It lets go."""  # let go\n')
    assert run(app, root) == 1
    out, err = capsys.readouterr()
    assert "`let go` stands 2 times in src, 1 are allowed: write release" in out
    assert "became more frequent: 1" in err


def test_budgets_are_lowered_and_never_raised(capsys, tmp_path):
    root = tree(tmp_path, "It lets go.\n", "")
    assert run(app, root) == 0
    assert "--lower" in capsys.readouterr().out
    assert run(app, [*root, "--lower"]) == 0
    lowered = TABLE.replace("docs = 2", "docs = 1").replace("src = 1", "src = 0")
    assert (tmp_path / "tools" / "dialect.toml").read_text(encoding="utf-8") == lowered
    (tmp_path / "README.md").write_text("It lets go. They let go.\n", encoding="utf-8")
    assert run(app, [*root, "--lower"]) == 1
    assert (tmp_path / "tools" / "dialect.toml").read_text(encoding="utf-8") == lowered


def test_the_length_of_a_page_is_that_of_its_prose_and_hand_written_tables():
    page = (
        "# A title\n\nIt `mkctl fly`s -> well.\n```sh\nmkctl top\n```\n| a | b |\n<!-- made -->\n| c |\n<!-- end -->\n"
    )
    assert length_of(page) == 8  # A, title, It, mkctl, flys, well, a, b


def test_what_stands_under_reference_is_looked_up_and_not_counted():
    assert length_of("# A title\n\n## Reference of keys\n\nOne two.\n\n## Reference\n\n### More\n\nmany words\n") == 7


def test_a_page_for_users_that_is_too_long_is_named(capsys, tmp_path):
    (tmp_path / "docs").mkdir()
    (tmp_path / "mkdocs.yml").write_text("nav:\n  - How-to:\n      - A: a.md\n  - Reference:\n      - B: b.md\n")
    (tmp_path / "docs" / "b.md").write_text("word " * 2 * LONGEST_PAGE)
    (tmp_path / "docs" / "a.md").write_text("word " * LONGEST_PAGE)
    assert run(app, ["--root", str(tmp_path)]) == 0
    (tmp_path / "docs" / "a.md").write_text("word " * (LONGEST_PAGE + 1))
    assert run(app, ["--root", str(tmp_path)]) == 1
    out, err = capsys.readouterr()
    assert "a.md: 901 words" in out
    assert "more than 900 words: 1" in err


def test_the_pages_of_this_tree_use_the_words(capsys):
    assert run(app, ["--root", str(ROOT)]) == 0
    assert "pages use the words" in capsys.readouterr().out
