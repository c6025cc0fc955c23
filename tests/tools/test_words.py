"""Pages say one thing by one word; code, links and quotations are not read."""

from __future__ import annotations

import pytest

from mkdaemon.cli.program import run
from tests.places import ROOT
from tools.words import REFUSED, app, refused_words


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


def test_the_pages_of_this_tree_use_the_words(capsys):
    assert run(app, ["--root", str(ROOT)]) == 0
    assert "pages use the words" in capsys.readouterr().out
