"""Debian's Chromium without a screen, and programs whose page it looks at."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from playwright.sync_api import Browser, Page, sync_playwright

PATIENCE = 180.0
"""Longest wait for anything [s]: a loaded machine is slow, not wrong."""
FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
"""CI is root, and has no graphics."""


@contextmanager
def chromium() -> Iterator[Browser]:
    """A browser; says what to install where there is none."""
    program = shutil.which("chromium")
    assert program is not None, "there is no browser: apt-get install chromium"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=list(FLAGS), timeout=PATIENCE * 1e3)
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def opened(browser: Browser, address: str) -> Iterator[tuple[Page, list[str]]]:
    """A page, and what went wrong in it: errors, and what it wanted from elsewhere."""
    page = browser.new_page(viewport={"width": 920, "height": 560})
    page.set_default_timeout(PATIENCE * 1e3)
    wrong: list[str] = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
    page.on(
        "request", lambda request: None if request.url.startswith((address, "data:")) else wrong.append(request.url)
    )
    page.goto(address)
    try:
        yield page, wrong
    finally:
        page.close()


@contextmanager
def program(module: str, *words: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """A program that prints where its page is: the address, and the process."""
    command = [sys.executable, "-m", module, *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert "http://" in line, line + process.stdout.read()
        yield "http" + line.partition("http")[2].split('"')[0].split(";")[0].strip(), process
    finally:
        process.terminate()
        try:
            process.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()


def said(page: Page, word: str) -> str:
    """What a line of the page says."""
    return page.locator(f"tr[data-line='{word}'] td.text").inner_text()


def wait_until(page: Page, claim: Any, what: str) -> None:
    """Wait until something is true of the page."""
    deadline = time.monotonic() + PATIENCE
    while not claim():
        assert time.monotonic() < deadline, f"{what}; the page says: {page.locator('#verdict').inner_text()}"
        page.wait_for_timeout(100)
