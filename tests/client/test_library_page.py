"""The programs of docs/library.md run as they stand there, and importing the library costs little."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys

import pytest

from lab.places import ROOT
from lab.rigs.desk import desk

PAGE = (ROOT / "docs" / "library.md").read_text(encoding="utf-8")


def program(heading):
    """The block of Python under a heading."""
    section = PAGE.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    return re.search(r"```python\n(.*?)```", section, re.DOTALL)[1]


@pytest.mark.parametrize(("heading", "name"), [("Watch", "watch_telemetry"), ("Fly", "take_off_and_land")])
def test_the_page_shows_examples_as_they_are(heading, name):
    assert program(heading) == (ROOT / "examples" / f"{name}.py").read_text(encoding="utf-8")


def test_a_capture_decodes_without_a_daemon(tmp_path):
    shutil.copy(ROOT / "tests/data/captures/nc_mixed_60s.jsonl", tmp_path / "flight.jsonl")
    call = [sys.executable, "-c", program("Decode a capture")]
    ended = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")
    lines = ended.stdout.splitlines()
    assert lines[0] == "  0.00 s  16.4 V, 9 satellites"
    assert "('OsdData5', 31)" in lines[-1]


def test_the_questions_are_answered(tmp_path):
    (tmp_path / "ask.py").write_text(program("Ask"), encoding="utf-8")
    with desk(tmp_path, board="fc") as made:
        lines = made.type(f"python {tmp_path}/ask.py").splitlines()
    assert lines[0].startswith("alive: True battery: ")
    assert lines[1].startswith("streams: {'attitude': ")
    assert lines[2] == "active parameter set: 3"
    assert lines[3].startswith("no_such_stream ")


def loaded_by(statement):
    """Modules a fresh interpreter holds after a statement."""
    code = f"import json, sys\n{statement}\nprint(json.dumps(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout.splitlines()[-1]))


def test_importing_the_library_loads_no_command_line_no_models_and_no_message_table():
    loaded = loaded_by("import mkdaemon.client")
    heavy = {"cyclopts", "rich", "pydantic", "numpy", "cv2", "mkdaemon.bus.keys", "mkdaemon.protocol.wire"}
    assert heavy & loaded == set()
    assert not any(name.startswith(("mkdaemon.daemon", "mkdaemon.link", "mksim")) for name in loaded)
