"""The page as text: nothing of a stranger is more than text in it, and it asks no network for anything."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
from html.parser import HTMLParser

import pytest

from mkdaemon.errors import ConfigError
from mkdaemon.view.report import page as page_module
from mkdaemon.view.report.make import report_of
from mkdaemon.view.report.page import plotly_source, render
from tests.view.report.known import write_known

LIBRARY = "window.Plotly = {}; // </script><!--"
HOSTILE = (
    "</script><script>alert(1)</script><img src=x onerror=alert(2)>\"'><a href='javascript:alert(3)'>&lt;b\u202e\0"
)


class Tags(HTMLParser):
    """What a browser would see."""

    def __init__(self, page):
        super().__init__(convert_charrefs=True)
        self.tags, self.attributes, self.scripts, self.text = [], [], [], ""
        self._inside = ""
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, name, value) for name, value in attrs]
        self._inside = tag
        if tag == "script":
            self.scripts.append([dict(attrs), ""])

    def handle_endtag(self, tag):
        self._inside = ""

    def handle_data(self, data):
        if self._inside == "script":
            self.scripts[-1][1] += data
        else:
            self.text += data


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    made = {}
    for name, word in (("known", ""), ("tame", " w"), ("hostile", HOSTILE)):
        report = report_of(write_known(folder / f"{name}.mcap", word), None)
        made[name] = Tags(render(report, LIBRARY).decode())
    return made


def test_what_strangers_wrote_makes_no_tag_and_no_attribute_in_the_page_nor_in_its_plots(pages):
    tame, hostile = pages["tame"], pages["hostile"]
    assert hostile.tags == tame.tags
    names = {(tag, name) for tag, name, _ in hostile.attributes}
    assert names == {(tag, name) for tag, name, _ in tame.attributes}
    assert not any(name.startswith("on") for _, name in names)
    assert "alert(1)" in hostile.text, "it is shown as what it is"
    plots = pages["hostile"].scripts[0][1]
    assert "<" not in plots
    assert "<" not in json.dumps(json.loads(plots)).replace("<extra></extra>", ""), (
        "what plotly gets has no tag in it either"
    )
    assert "&lt;img" in json.dumps(json.loads(plots))


def test_nothing_comes_from_elsewhere_and_only_the_two_scripts_that_are_ours_may_run(pages):
    for page in pages.values():
        outside = [value for _, name, value in page.attributes if name in {"src", "href", "action", "srcset"}]
        assert outside
        assert all(value.startswith("data:image/jpeg;base64,") for value in outside)
        policy = next(value for tag, name, value in page.attributes if name == "content" and "script-src" in value)
        assert policy.startswith("default-src 'none'; script-src 'sha256-")
        assert "http" not in policy
    page = pages["hostile"]
    figures, library, script = page.scripts
    assert (figures[0]["type"], library[0]["type"], script[0]) == ("application/json", "text/plain", {})
    policy = next(value for tag, name, value in page.attributes if name == "content" and "script-src" in value)
    unpacked = gzip.decompress(base64.b64decode(library[1])).decode()
    assert unpacked == LIBRARY
    for text in (script[1], unpacked):
        assert f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'" in policy


def test_the_known_values_are_in_the_plots_and_tables_and_pictures_where_something_happened(pages):
    plots = {plot["name"]: plot for plot in json.loads(pages["known"].scripts[0][1])}
    assert list(plots) == [
        *("target", "events", "height", "error", "place", "link", "loss", "eyes0", "battery"),
    ]
    height = plots["height"]["data"][0]
    assert (height["name"], height["x"][0], height["y"][0], height["y"][-1]) == (
        *("estimate, over the target", 1.0, 2.5, 1.98),
    )
    assert plots["error"]["data"][0]["y"][0] == 20.0
    assert plots["battery"]["data"][0]["y"][-1] == 15.0
    assert plots["target"]["times"][0] == 1.0
    assert plots["target"]["data"][0]["x"][-1] == 1.03
    text = pages["known"].text
    for words in (
        *("5.0 / 5.0", "1.00, 0.00, 2.00", "not_leased", "nobody holds it", "refusals and remedies"),
        *("15.0 to 16.0, on average 15.5; first 16.0, last 15.0", "15.0 V, 3.75 V a cell, 10.0 A, 30 mAh"),
        *("50.0 to 50.0, on average 50.0", "97 of 100 answered, 1 late, 2 unanswered (2 lost)"),
        *("up 8.0 s, degraded 2.0 s", "10 images/s, 50 % posed, 60 ms", "images processed100"),
        *("model: a1", "3.5", "as it was", "fc 2.12a", "mkdaemon 1 on box (blackbox)"),
    ):
        assert words.lower() in text.lower()
    pictures = [value for tag, name, value in pages["known"].attributes if (tag, name) == ("img", "src")]
    assert 4 <= len(pictures) <= 11
    assert len(set(pictures)) == len(pictures)


def test_a_missing_library_is_named(monkeypatch):
    monkeypatch.setattr(page_module, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r'pip install "mkdaemon\[report\]"'):
        plotly_source()
