"""The main job on recorded traffic of genuine boards, by a plain subscriber; and a system clock that is set."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections import Counter
from pathlib import Path

import msgpack
import pytest
import zenoh

from lab.rigs.programs import PATIENCE, mkdaemon
from lab.rigs.waiting import wait_until
from mkdaemon.clock import Clock
from mkdaemon.config.root import Config
from mkdaemon.daemon.program import run
from tests.bus.support import bus_config, client, free_endpoint
from tests.places import CAPTURES, DATA

EXCERPT = CAPTURES / "nc_mixed_60s.jsonl"


class Subscriber:
    """Knows nothing of ours: a client session and msgpack."""

    def __init__(self, endpoint: str) -> None:
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("transport/link/tx/lease", "60000")
        config.insert_json5("connect/timeout_ms", f"{PATIENCE * 1000:.0f}")
        config.insert_json5("connect/retry", '{"period_init_ms": 50, "period_max_ms": 500}')
        self.session = zenoh.open(config)
        self.gone = threading.Event()
        self.counts: Counter[str] = Counter()
        self.values: dict[str, list[dict]] = {}
        self.encodings: dict[str, str] = {}
        self.session.declare_subscriber("mk/mk1/**", zenoh.handlers.Callback(self._take, indirect=False))
        alive = zenoh.handlers.Callback(self._see, indirect=False)
        self.session.liveliness().declare_subscriber("mk/mk1/alive", alive)

    def _see(self, token: zenoh.Sample) -> None:
        """The token goes behind everything the daemon has said: in this order it comes out of one line."""
        if token.kind == zenoh.SampleKind.DELETE:
            self.gone.set()

    def _take(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr).removeprefix("mk/mk1/")
        self.counts[key] += 1
        self.encodings[key] = str(sample.encoding)
        self.values.setdefault(key, []).append(msgpack.unpackb(sample.payload.to_bytes()))


PATIENT = """{transport: {link: {tx: {queue: {congestion_control: {drop: {
  wait_before_drop: 60000000, max_wait_before_drop_fragments: 60000000}}}}}}}"""
"""A subscriber that stands still for a while loses nothing here [us]; in flight a second must do."""


def replayed(recording: Path, folder: Path) -> Subscriber:
    """Everything a subscriber hears while the daemon plays a recording twenty times as fast as it was recorded."""
    endpoint = free_endpoint()
    config, patient = folder / "daemon.toml", folder / "patient.json5"
    patient.write_text(PATIENT, encoding="utf-8")
    config.write_text(
        f'[link]\nport = "replay:{recording}?speed=20"\nwait_for_port = true\n'
        f'[bus]\nlisten = ["{endpoint}"]\nlease = 30.0\nzenoh_file = "{patient}"\n',
        encoding="utf-8",
    )
    with mkdaemon("run", "--config", str(config)) as process:
        subscriber = Subscriber(endpoint)  # it waits for us, however late we are
        try:
            _, errors = process.communicate(timeout=PATIENCE)
            assert process.returncode == 0, errors
            assert subscriber.gone.wait(PATIENCE)
        finally:
            subscriber.session.close()
    return subscriber


@pytest.fixture(scope="module")
def heard(tmp_path_factory) -> Subscriber:
    return replayed(EXCERPT, tmp_path_factory.mktemp("replay"))


def test_not_one_frame_of_the_recording_is_lost(heard):
    received = [json.loads(line) for line in EXCERPT.read_text(encoding="utf-8").splitlines()]
    wire = b"".join(bytes.fromhex(line["hex"]) for line in received if line.get("dir") == "rx")
    for key, letters in (("osd", b"#cO"), ("attitude", b"#cC"), ("debug", b"#cD")):
        assert heard.counts[f"rx/nc/{key}"] == wire.count(letters) > 0
    sequence = [value["sequence"] for value in heard.values["raw/rx"]]
    assert sequence == list(range(1, len(sequence) + 1))
    assert len(sequence) == sum(count for key, count in heard.counts.items() if key.startswith("rx/"))


def test_si_values_agree_with_the_frames_they_came_from(heard):
    for frame, battery, position in zip(
        heard.values["rx/nc/osd"], heard.values["state/battery"], heard.values["state/position"], strict=True
    ):
        fields = frame["fields"]
        assert battery["voltage"] == pytest.approx(fields["battery"] / 10)
        assert battery["stamp"] == position["stamp"] == frame["stamp"]
        assert position["latitude_deg"] == pytest.approx(fields["position_latitude"] * 1e-7)
        east, north, up = position["position_enu"]
        assert (east**2 + north**2) ** 0.5 == pytest.approx(fields["home_distance"] / 10, abs=0.15, rel=0.01)
        assert up == pytest.approx(fields["altimeter"] * 0.05)
    assert heard.encodings["rx/nc/osd"] == "application/msgpack;mk.OsdData5.v1"


RECORDING = DATA / "captures" / "nc_mixed_60s.jsonl"
SETTLED = 2.0
"""Stamps are right again so long after the step [s]."""
TOLERANCE = 0.1
"""How right [s]."""
REGULAR = {"mk/t/raw/rx", "mk/t/rx/nc/osd", "mk/t/state/attitude", "mk/t/link/health", "mk/t/health"}


async def test_after_a_step_of_an_hour_stamps_are_right_within_2_s_and_an_event_says_so():
    shift, step = 0.0, -3600.0
    clock = Clock(wall=lambda: time.time() + shift)
    endpoint = free_endpoint()
    cfg = Config.model_validate(
        {"link": {"port": f"replay:{RECORDING}"}, "bus": bus_config(endpoint), "vehicle": {"name": "t"}}
    )
    stop = asyncio.Event()
    daemon = asyncio.create_task(run(cfg, stop, clock))
    heard: list[tuple[str, dict]] = []

    def on_sample(sample: zenoh.Sample) -> None:
        heard.append((str(sample.key_expr), msgpack.unpackb(sample.payload.to_bytes())))

    def has_all(since: float) -> bool:
        """Whether whatever comes regularly, once a second at least, was stamped after a time."""
        return {key for key, value in heard if value["stamp"]["monotonic"] > since} >= REGULAR

    session = client(endpoint)
    with await asyncio.to_thread(session.__enter__) as opened:
        opened.declare_subscriber("mk/t/**", on_sample)
        await wait_until(lambda: has_all(0.0), PATIENCE, 0.05)
        shift, stepped_at = step, time.monotonic()
        await wait_until(lambda: has_all(stepped_at + SETTLED), PATIENCE, 0.05)
        offset = time.time() + shift - time.monotonic()
    stop.set()
    await asyncio.wait_for(daemon, PATIENCE)

    [event] = [value for key, value in heard if key == "mk/t/event/clock"]
    assert event["step"] == pytest.approx(step, abs=TOLERANCE)
    assert 0 <= event["stamp"]["monotonic"] - stepped_at <= SETTLED
    stamps = {}
    for key, value in heard:
        stamp = value["stamp"]
        if stamp["monotonic"] - stepped_at > SETTLED:
            stamps[key] = abs(stamp["wall"] - stamp["monotonic"] - offset)
    assert max(stamps.values()) < TOLERANCE
