"""The page in a browser: the true values of a known flight read back, zoom and pointer in all plots, nothing asked for.

Chromium is Debian's; `make check-view` runs these.
"""

from __future__ import annotations

import pytest

from lab.rigs.browsing import chromium
from mkdaemon.view.report.make import make_page
from tests.view.report.known import write_known
from tests.view.report.test_page import HOSTILE

pytestmark = pytest.mark.browser
READY = "body[data-ready=yes]"


class Opened:
    """A page that is ready, and what it did meanwhile."""

    def __init__(self, browser, path):
        self.asked, self.errors, self.dialogs = [], [], []
        self.page = browser.new_page(viewport={"width": 1200, "height": 900})
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", lambda line: self.errors.append(line.text) if line.type == "error" else None)
        self.page.on("dialog", lambda dialog: (self.dialogs.append(dialog.message), dialog.dismiss()))
        self.page.goto(path.as_uri())
        self.page.wait_for_selector(READY, timeout=240_000)

    def plot(self, name, what):
        """A part of a plot as plotly has it."""
        return self.page.evaluate(f"document.getElementById('plot-{name}').{what}")


@pytest.fixture(scope="module")
def browser():
    with chromium() as started:
        yield started


@pytest.fixture(scope="module")
def known(browser, tmp_path_factory):
    folder = tmp_path_factory.mktemp("known")
    path = folder / "known.html"
    path.write_bytes(make_page(write_known(folder / "known.mcap"), None))
    return Opened(browser, path)


def test_the_page_asks_for_nothing_but_itself(known):
    assert [url for url in known.asked if not url.startswith(("data:", "blob:"))] == [known.page.url]
    assert known.errors == []


def test_the_true_values_are_read_back_from_the_page(known):
    height = known.plot("height", "data[0]")
    assert (height["x"][0], height["y"][0], height["y"][-1]) == (1.0, 2.5, 1.98)
    assert known.plot("error", "data[0].y")[-1] == 5.0
    # What is drawn, not only what was given: the line of the voltage ends at its 15.0 V.
    drawn = known.page.evaluate(
        """() => {
            const plot = document.getElementById('plot-battery');
            const path = plot.querySelector('.scatterlayer .trace path.js-line').getAttribute('d');
            const [x, y] = path.split(/[ML]/).pop().split(',').map(Number);
            const { xaxis, yaxis } = plot._fullLayout;
            return [xaxis.p2d(x), yaxis.p2d(y)];
        }"""
    )
    assert drawn == pytest.approx([10.0, 15.0], abs=0.05)
    row = known.page.locator("#pieces tr", has_text="position").inner_text().split("\t")
    assert [cell.strip() for cell in row[:7]] == ["position", "1.00, 0.00, 2.00", "3.0", "6.0", "3.0", "-", "5.0 / 5.0"]
    assert "5.0 cm at most, in position" in known.page.locator("#words").inner_text()


def test_who_zooms_one_plot_zooms_all(known):
    known.page.evaluate("Plotly.relayout('plot-battery', {'xaxis.range[0]': 2, 'xaxis.range[1]': 5})")
    plots = "Array.from(document.querySelectorAll('[id^=plot-]')).filter((one) => one.layout)"
    zoomed = "((one) => `${one.layout.xaxis.range}` === '2,5')"
    known.page.wait_for_function(f"{plots}.filter({zoomed}).length === 8")


def test_the_pointer_shows_one_moment_everywhere(known):
    known.page.locator("#events tr[data-at='4.000']").first.click()
    here = "document.getElementById('plot-target').data.at(-1).x"
    known.page.wait_for_function(f"{here}.length === 1 && Math.abs({here}[0] - 1.12) < 1e-9")
    # Hovering is drawn a moment later; plotly's own texts say height and time.
    said = "document.querySelector('#plot-height .hoverlayer').textContent"
    known.page.wait_for_function(f"{said}.includes('2.5') && {said}.includes('4.00')")


def test_what_strangers_wrote_runs_nothing(browser, tmp_path):
    path = tmp_path / "hostile.html"
    path.write_bytes(make_page(write_known(tmp_path / "hostile.mcap", HOSTILE), None))
    opened = Opened(browser, path)
    # Plotly shows texts of its own making; they must be texts there as well.
    box = opened.page.locator("#plot-events .points path").first
    box.hover(force=True)
    inside = "main a, main script, main img:not([src^='data:image/jpeg']), main svg a"
    assert opened.page.locator(inside).count() == 0
    assert opened.dialogs == []
    assert opened.errors == []
    assert [url for url in opened.asked if not url.startswith(("data:", "blob:"))] == [opened.page.url]
