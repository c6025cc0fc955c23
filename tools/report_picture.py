"""`python -m tools.report_picture RECORDING`: the picture of docs/look.md, out of a recording of the demonstration.

Needs Debian's Chromium. `mkdaemon demo --fast` makes the recording.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path
from typing import Final

from playwright.sync_api import sync_playwright

from lab.places import ROOT
from mkdaemon.view.report.make import make_page

PICTURE: Final = ROOT / "docs" / "figures" / "report.png"
WIDTH, HEIGHT = 1100, 1720
"""Of the part of the page that is shown [px]."""
PATIENCE: Final = 300.0
"""Longest wait for the plots [s]."""


def main(recording: Path) -> None:
    """Draw it."""
    program = shutil.which("chromium")
    assert program is not None, "there is no browser: apt-get install chromium"
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        page_file = Path(folder) / "report.html"
        page_file.write_bytes(make_page(recording, None))
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"], timeout=PATIENCE * 1e3)
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        page.goto(page_file.as_uri())
        page.wait_for_selector("body[data-ready=yes]", timeout=PATIENCE * 1e3)
        page.screenshot(path=PICTURE)
        browser.close()
    print(f"{PICTURE}: {PICTURE.stat().st_size} bytes")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
