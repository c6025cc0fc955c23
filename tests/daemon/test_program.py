"""Starting and ending: signals, exit codes, and mistakes named in one line by `run` and by the doctor."""

from __future__ import annotations

import asyncio
import os
import re
import signal
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
from mkdaemon.cli.mkdaemon.doctor.check import Severity
from mkdaemon.cli.mkdaemon.doctor.machine import Machine
from mkdaemon.cli.mkdaemon.doctor.table import examine
from mkdaemon.cli.program import run
from mkdaemon.config.reader import load
from mkdaemon.daemon.program import run as run_daemon
from mkdaemon.errors import ConfigError
from tests.bus.support import free_endpoint
from tests.places import CONFIGS


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


TARGET = str(CONFIGS / "targets" / "nested.toml")
CAMERA = f'[[cameras]]\nsource = "/dev/video9"\ntargets = ["{TARGET}"]\n'
PORT = '[link]\nport = "/dev/ttyUSB0"\n'
WRONG = {
    "two cameras of one name": (PORT + CAMERA + CAMERA, "two cameras are called 'down'"),
    "a target file as calibration": (PORT + CAMERA + f'calibration = "{TARGET}"\n', "camera file"),
    "a calibration that is not there": (PORT + CAMERA + 'calibration = "none.toml"\n', "calibrate camera"),
    "a camera without targets": (PORT + '[[cameras]]\nsource = "/dev/video9"\n', "no targets"),
    "a source that is none": (PORT + CAMERA.replace("/dev/video9", "the front one"), "'the front one' is none of"),
    "a stream nobody sends": (PORT + "rates = { osf = 100 }\n", "there is no stream 'osf'"),
    "more than the line carries": (PORT + "rates = { osd = 20, debug = 70 }\n", "% of the line"),
    "a port without its folder": ('[link]\nport = "ttyUSB0"\n', "/dev/ttyUSB0"),
    "a port of no kind": ('[link]\nport = "udp:10.0.0.1:7"\n', "is not a port"),
    "a loop that is not safe": (PORT + "[control.limiter]\nslew = 50\n" + CAMERA, "control.limiter.slew"),
    "a bus open to everybody": (
        PORT + '[bus]\nlisten = ["tcp/0.0.0.0:7447"]\n',
        "every program in the network could",
    ),
    "an endpoint that is none": (PORT + '[bus]\nlisten = ["7447"]\n', "is not a Zenoh endpoint"),
    "a group that nobody is in": (PORT + '[bus]\nlocal_group = "no-such-group"\n', "no group 'no-such-group'"),
}


@pytest.fixture
def machine(tmp_path):
    (tmp_path / "root").mkdir()
    return Machine(tmp_path / "root")


@pytest.mark.parametrize(("text", "words"), WRONG.values(), ids=WRONG)
async def test_what_run_refuses_the_doctor_calls_bad_in_the_same_words(text, words, tmp_path, machine):
    path = tmp_path / "aircraft.toml"
    path.write_text(text, encoding="utf-8")
    try:
        cfg = load(path)
    except ConfigError as error:
        refusal = str(error)
    else:
        with pytest.raises(ConfigError) as refused:
            await run_daemon(cfg, asyncio.Event())
        refusal = str(refused.value)
    assert words in refusal
    found = [finding for finding in examine(machine, path).findings if finding.check == "configuration"]
    assert (found[0].severity, found[0].what) == (Severity.ERROR, refusal)
