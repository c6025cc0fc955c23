"""Starting and ending: signals, exit codes, and mistakes named in one line."""

from __future__ import annotations

import fcntl
import os
import re
import signal
import socket
import sys
import termios
import threading
import time
import tty

import pytest
import zenoh

from lab.rigs.programs import PATIENCE, mkdaemon
from mkdaemon.bus.session import session_config
from mkdaemon.cli.mkdaemon.app import app
from mkdaemon.cli.program import run
from tests.bus.support import free_endpoint


@pytest.fixture
def terminal():
    """A pseudo terminal nobody answers on: near end, name of the far end."""
    near, far = os.openpty()
    tty.setraw(far, termios.TCSANOW)
    yield near, os.ttyname(far)
    for descriptor in (near, far):
        os.close(descriptor)


def wait_until_it_listens(endpoint, process):
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            return zenoh.open(session_config("client", connect=[endpoint], patience=0.2))
        except zenoh.ZError:
            assert process.poll() is None, process.communicate()[1]
            assert time.monotonic() < deadline
            time.sleep(0.05)


END = b"nothing comes behind this"


def read_on(near, written):
    """Keep what is written until the mark comes."""
    while not written.endswith(END):
        written += os.read(near, 4096)


def test_a_signal_ends_everything_in_order_and_the_last_bytes_are_a_release(terminal):
    near, far = terminal
    endpoint = free_endpoint()
    written = bytearray()
    reading = threading.Thread(target=read_on, args=(near, written), daemon=True)
    reading.start()
    with mkdaemon("run", "--port", f"pty:{far}", "--listen", endpoint) as process:
        session = wait_until_it_listens(endpoint, process)
        deadline = time.monotonic() + PATIENCE
        while len(written) < 64:
            assert time.monotonic() < deadline, "it never wrote anything"
            time.sleep(0.01)
        process.send_signal(signal.SIGTERM)
        out, err = process.communicate(timeout=PATIENCE)
        session.close()
    mark = os.open(far, os.O_RDWR | os.O_NOCTTY)
    os.write(mark, END)
    os.close(mark)
    reading.join(PATIENCE)
    assert process.returncode == 0, err
    assert "Traceback" not in out + err
    first = rest = bytes(written).removesuffix(END)
    # A release of the layout that is safe on every firmware: 22 characters, all zero but the frame number.
    assert first.lstrip(b"\r").startswith(b"#bb=======")
    assert rest.rstrip(b"\r").rpartition(b"#")[2].startswith(b"bb=======")


@pytest.fixture
def mistake(capfd, monkeypatch):
    """Exit code and the one line of a start that must fail, in this process."""
    handlers = {name: signal.getsignal(name) for name in (signal.SIGINT, signal.SIGTERM, signal.SIGPIPE)}

    def start(*arguments):
        with monkeypatch.context() as patched:
            patched.setattr(sys, "stderr", sys.stderr)  # the program puts a queue in its place
            code = run(app, ["run", "--log", "error", *arguments])
            sys.stderr.drain()
        out, err = capfd.readouterr()
        lines = [line for line in err.splitlines() if line.startswith("mkdaemon:")]
        assert out == ""
        assert "Traceback" not in err
        assert len(lines) == 1, err
        return code, lines[0]

    yield start
    for name, handler in handlers.items():
        signal.signal(name, handler)


def test_no_port_at_all(mistake):
    assert mistake() == (
        2,
        "mkdaemon: link.port: no port is configured; set it, or give --port (mkdaemon doctor lists what is plugged in)",
    )


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (["--config", "my.toml"], 2, r'my\.toml:4: link\.prot: unknown key; did you mean "port"\?$'),
        (["--config", "nothing/here.toml"], 2, "nothing/here.toml: no such configuration file"),
        (["--port", "/dev/ttyUSB-nothing"], 1, "/dev/ttyUSB-nothing"),
        (["--port", "usb:0"], 2, "usb:0"),
        (["--port", "replay:absent.jsonl"], 2, "absent.jsonl"),
        (["--port", "replay:empty.jsonl"], 2, "empty.jsonl"),
        (["--port", "replay:none.jsonl"], 2, "none.jsonl"),
    ],
)
def test_a_mistake_is_named_in_one_line(mistake, tmp_path, monkeypatch, words, code, told):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my.toml").write_text('[vehicle]\nname = "x"\n[link]\nprot = "tcp:localhost:1"\n', encoding="utf-8")
    (tmp_path / "empty.jsonl").touch()
    (tmp_path / "none.jsonl").write_text("no recording\n", encoding="utf-8")
    found, line = mistake(*words, *(() if "--config" in words else ("--listen", free_endpoint())))
    assert found == code
    assert re.search(told, line)


def test_a_port_another_program_holds(mistake, terminal):
    _, far = terminal
    holder = os.open(far, os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(holder, fcntl.LOCK_EX | fcntl.LOCK_NB)
    try:
        code, line = mistake("--port", far, "--listen", free_endpoint())
    finally:
        os.close(holder)
    assert code == 1
    assert far in line


def test_a_bus_endpoint_in_use(mistake):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        code, line = mistake("--port", "tcp:localhost:9", "--listen", endpoint)
    assert code == 1
    assert f"bus.listen {endpoint} is in use: another mkdaemon runs here" in line
