"""How little importing the library costs."""

from __future__ import annotations

import json
import subprocess
import sys


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
