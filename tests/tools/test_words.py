"""Pages say one thing by one word; code, links and quotations are not read."""

from __future__ import annotations

import pytest

from mkdaemon.cli.program import run
from tests.places import ROOT
from tools.words import DIALECT, LONGEST_PAGE, REFUSED, app, length_of, prose_of, refused_words


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
    assert [tuple(one) for one in refused_words(prose_of(text), REFUSED)] == found


def test_what_is_to_be_written_is_not_refused_itself():
    for instead in (*REFUSED.values(), *DIALECT.values()):
        assert list(refused_words(instead, REFUSED | DIALECT)) == []


def test_a_page_with_another_word_is_named_with_its_line(capsys, tmp_path):
    page = tmp_path / "README.md"
    page.write_text("# A\n\nThe drone.\n", encoding="utf-8")
    assert run(app, ["--root", str(tmp_path)]) == 1
    out, err = capsys.readouterr()
    assert out == "README.md:3: `drone`: write aircraft\n"
    assert "words that are not used: 1;" in err
    page.write_text("# A\n\nThe aircraft.\n", encoding="utf-8")
    assert run(app, ["--root", str(tmp_path)]) == 0


def test_a_phrase_of_the_dialect_is_refused_in_pages_and_sources_and_other_words_in_pages(capsys, tmp_path):
    (tmp_path / "README.md").write_text("Nobody.\n`nobody` is code.\n", encoding="utf-8")
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "a.py").write_text('"""A drone."""\n# nobody\n', encoding="utf-8")
    assert run(app, ["--root", str(tmp_path)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition(": write")[0] for line in lines] == ["README.md:1: `Nobody`", "src/a.py:2: `nobody`"]


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
