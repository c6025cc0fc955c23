"""A camera's life: streaming, unplugged and back, silent, at its end; stamps; what each source gives."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
import zenoh

from mkdaemon.bus.codec import encode
from mkdaemon.clock import Clock
from mkdaemon.config.camera import CameraSection
from mkdaemon.errors import ConfigError, VisionError
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.telemetry.signature import private_key, sign
from mkdaemon.telemetry.vision import EyeState
from mkdaemon.vision.camera import sources
from mkdaemon.vision.camera.camera import CameraStream, StampClock
from mkdaemon.vision.camera.image import CameraImage, EndOfImages, ImageSource, NewestSlot, PictureError, Shot
from mkdaemon.vision.camera.imagecodec import encode_jpeg
from mkdaemon.vision.camera.sources import list_pictures, source_of
from tests.vision.streams import wait_for_status

PATIENCE = 60.0


def picture(grey: int = 100) -> np.ndarray:
    return np.full((48, 64), grey, dtype=np.uint8)


class Scripted(ImageSource):
    """A camera that does what the script says: an image, nothing, unplugged, at its end."""

    def __init__(self, script: list[str]) -> None:
        self.script: Iterator[str] = iter(script)
        self.opened = 0
        self.missing = False
        self.drained = threading.Event()

    def open(self) -> tuple[str, ...]:
        self.opened += 1
        if self.missing:
            self.missing = False
            raise VisionError("camera test: /dev/video7 is not there: plug it in")
        return ("gain=3: the driver has 1",)

    def read(self, timeout: float) -> Shot | None:
        step = next(self.script, "")
        if step == "image":
            return Shot(picture(), time.monotonic(), None)
        if step == "unplug":
            self.missing = True
            raise VisionError("camera test: /dev/video7 gives no more images")
        if step == "damaged":
            raise PictureError("damaged JPEG: premature end of data segment")
        if step == "fault":
            raise OSError(5, "Input/output error")
        if step == "end":
            raise EndOfImages
        self.drained.set()
        threading.Event().wait(timeout)
        return None

    def close(self) -> None:
        pass


def run(source: Scripted, **options: object) -> tuple[CameraStream, NewestSlot[CameraImage]]:
    cfg = CameraSection.model_validate(
        {"name": "test", "source": "scripted", "reopen_min": 0.01, "reopen_max": 0.02, **options}
    )
    slot: NewestSlot[CameraImage] = NewestSlot()
    stream = CameraStream(cfg, source, slot)
    stream.start()
    return stream, slot


def test_an_unplugged_camera_is_named_and_comes_back() -> None:
    source = Scripted(["image", "image", "unplug", "image"])
    stream, slot = run(source, silent_after=PATIENCE)
    assert source.drained.wait(PATIENCE)
    status = wait_for_status(stream, lambda s: s.images == 3)
    assert status.state is EyeState.OK
    assert status.settings_refused == ("gain=3: the driver has 1",)
    assert (source.opened, status.reopened) == (3, 2)  # lost, missing once, back
    image = slot.take(0.0)
    assert (image.sequence, image.camera, image.stamped_by) == (3, "test", "arrival")
    assert slot.dropped["test"] == 2
    stream.stop()


def test_a_driver_that_raises_anything_is_opened_again() -> None:
    source = Scripted(["image", "fault", "image"])
    stream, _ = run(source, silent_after=PATIENCE)
    assert source.drained.wait(PATIENCE)
    status = wait_for_status(stream, lambda s: s.images == 2)
    assert (status.state, source.opened, status.reopened) == (EyeState.OK, 2, 1)
    stream.stop()


def test_a_camera_with_nothing_but_damaged_images_says_what_is_wrong_with_them() -> None:
    source = Scripted(["image", *["damaged"] * 4])
    stream, _ = run(source, silent_after=0.02)
    assert source.drained.wait(PATIENCE)
    status = wait_for_status(stream, lambda s: s.state is EyeState.SILENT)
    assert (status.reason, status.damaged, status.images) == ("damaged JPEG: premature end of data segment", 4, 1)
    assert source.opened == 1
    stream.stop()


def test_a_missing_camera_says_so_until_it_is_there() -> None:
    source = Scripted([])
    source.open = lambda: (_ for _ in ()).throw(VisionError("camera test: not there"))  # type: ignore[method-assign]
    stream, _ = run(source)
    status = wait_for_status(stream, lambda s: s.state is EyeState.GONE and s.reopened >= 3)
    assert status.reason == "camera test: not there"
    stream.stop()


def test_a_camera_without_images_is_silent_then_streaming_again() -> None:
    gate = threading.Event()
    source = Scripted(["image"])
    original = source.read

    def read(timeout: float) -> Shot | None:
        return Shot(picture(), time.monotonic()) if gate.is_set() else original(timeout)

    source.read = read  # type: ignore[method-assign]
    stream, _ = run(source, silent_after=0.05)
    status = wait_for_status(stream, lambda s: s.state is EyeState.SILENT)
    assert "no image for" in status.reason
    assert status.fps == 0.0
    gate.set()
    wait_for_status(stream, lambda s: s.state is EyeState.OK)
    stream.stop()


def test_the_pause_before_a_camera_is_opened_again_doubles_to_the_longest(monkeypatch: pytest.MonkeyPatch) -> None:
    source = Scripted([])
    source.open = lambda: (_ for _ in ()).throw(VisionError("camera test: not there"))  # type: ignore[method-assign]
    cfg = CameraSection(source="/dev/video7", reopen_min=0.2, reopen_max=1.0)
    stream, pauses = CameraStream(cfg, source, NewestSlot[CameraImage]()), []

    def wait(pause: float) -> None:
        pauses.append(round(pause, 3))
        if len(pauses) == 5:
            stream.stop()

    monkeypatch.setattr(stream._stop, "wait", wait)
    stream._run()
    assert pauses == [0.2, 0.4, 0.8, 1.0, 1.0]


def test_the_newest_image_wins() -> None:
    slot: NewestSlot[int] = NewestSlot()
    for value in range(5):
        slot.put(value)
    assert (slot.take(0.0), slot.take(0.0), slot.dropped.total()) == (4, None, 4)
    slot.close()
    assert slot.take(PATIENCE) is None


def test_a_stamp_on_our_clock_is_taken_as_it_is() -> None:
    clock = StampClock(latency=0.01)
    assert clock.stamp(99.97, 100.0) == (pytest.approx(99.96), "driver")
    assert clock.stamp(None, 100.0) == (pytest.approx(99.99), "arrival")


def test_on_another_clock_the_smallest_delay_is_the_offset() -> None:
    clock, rng = StampClock(), np.random.default_rng(3)
    errors = []
    knew = []
    for k in range(400):
        taken = 1000.0 + k / 30.0
        arrived = taken + 0.04 + float(rng.exponential(0.01))
        stamp, by = clock.stamp(taken - 990.0, arrived)
        errors.append(stamp - taken - 0.04)
        knew.append(by)
    assert set(knew[:50]) == {"arrival"}, "not before its clock was seen to run as ours"
    assert set(knew[80:]) == {"driver"}
    assert 0.0 <= max(errors[80:]) < 0.001  # the constant 40 ms cannot be seen, the jitter is gone
    restarted, by = clock.stamp(0.5, 1100.0)
    assert (restarted, by) == (pytest.approx(1100.0), "arrival")


@pytest.mark.parametrize("true_hz", [5.0, 10.0, 24.0, 26.0, 40.0])
def test_images_numbered_at_a_nominal_rate_are_stamped_by_their_arrival(true_hz: float) -> None:
    clock, rng = StampClock(), np.random.default_rng(4)
    for k in range(600):
        arrived = 5000.0 + k / true_hz + float(rng.exponential(0.004))
        stamp, by = clock.stamp(0.04 * (k + 1), arrived)  # as FFmpeg counts an HTTP stream
        assert (stamp, by) == (arrived, "arrival")


def test_a_believed_clock_survives_a_slow_network_and_is_given_up_when_its_rate_changes() -> None:
    clock, rng = StampClock(), np.random.default_rng(5)
    taken, stamps = 0.0, 0.0
    knew: dict[str, list[str]] = {"good": [], "crowded": [], "half": []}
    for phase, step, delay in (("good", 1 / 30, 0.0), ("crowded", 1 / 30, 0.2), ("half", 1 / 15, 0.0)):
        for _ in range(300):
            taken += step
            stamps += 1 / 30  # a camera that halves its rate at dusk, still numbered at 30 a second
            at = 9000.0 + taken
            stamp, by = clock.stamp(stamps, at + delay + float(rng.exponential(0.005)))
            knew[phase].append(by)
            assert stamp - at < delay + 0.1
            assert at - stamp < 0.7, "never far behind what arrived"
    assert set(knew["good"][90:]) == {"driver"}
    assert set(knew["crowded"]) == {"driver"}
    assert set(knew["half"][30:]) == {"arrival"}


def test_the_rate_is_that_of_bursts_and_gaps_together() -> None:
    source = Scripted([])
    began = time.monotonic()
    times = iter([began + (k // 2) / 10.0 + 0.001 * (k % 2) for k in range(60)])
    source.read = lambda timeout: (  # type: ignore[method-assign]
        Shot(picture(), at) if (at := next(times, None)) is not None else Scripted.read(source, timeout)
    )
    stream, _ = run(source, silent_after=60.0)
    status = wait_for_status(stream, lambda s: s.images == 60)
    assert status.fps == pytest.approx(20.0, rel=0.05)
    stream.stop()


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("v4l2:/dev/video99", "/dev/video99 is not there"),
        ("file:missing.avi", "no such file: missing.avi"),
        ("folder:missing", "no such folder: missing"),
        ("http://127.0.0.1:1/none", "FFMPEG cannot open http.*: check address"),
    ],
)
def test_a_source_that_is_not_there_says_so(source: str, words: str) -> None:
    with pytest.raises(VisionError, match=words):
        source_of(CameraSection(source=source, reopen_max=0.3)).open()


def test_a_backend_that_is_missing_or_fails_is_named() -> None:
    with pytest.raises(VisionError, match=r"built without GSTREAMER|GSTREAMER cannot open nosuchelement"):
        source_of(CameraSection(source="gstreamer:nosuchelement")).open()


def test_a_source_nobody_understands_is_a_configuration_error() -> None:
    with pytest.raises(ConfigError, match=r"camera down: source"):
        source_of(CameraSection(source="webcam"))


def test_images_of_the_bus_need_one() -> None:
    with pytest.raises(VisionError, match="needs the bus"):
        source_of(CameraSection(source="zenoh:key")).open()


def test_a_folder_is_shown_in_natural_order_to_its_end(tmp_path: Path) -> None:
    for number in (10, 2, 1):
        cv2.imwrite(str(tmp_path / f"image{number}.png"), picture(20 * number))
    (tmp_path / "image3.png").write_bytes(b"no picture")
    (tmp_path / "notes.txt").write_text("ignored")
    assert [path.stem for path in list_pictures(tmp_path)] == ["image1", "image2", "image3", "image10"]
    cfg = CameraSection(source=f"folder:{tmp_path}", paced=False)
    slot: NewestSlot[CameraImage] = NewestSlot()
    stream = CameraStream(cfg, source_of(cfg), slot)
    stream.start()
    seen = [image for _ in range(3) if (image := slot.take(PATIENCE)) is not None]
    assert [int(image.pixels[0, 0]) for image in seen] == [20, 40, 200]
    wait_for_status(stream, lambda s: s.state is EyeState.ENDED)
    assert slot.dropped.total() == 0
    stream.stop()


def clip_of(folder: Path, pictures: int) -> Path:
    """A clip of 50 pictures a second, each brighter than the one before by 40."""
    path = folder / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 50.0, (64, 48), isColor=False)
    for k in range(pictures):
        writer.write(picture(40 * k))
    writer.release()
    return path


def test_a_clip_is_played_at_its_own_rate(tmp_path: Path) -> None:
    source = source_of(CameraSection(source=f"file:{clip_of(tmp_path, 6)}"))
    source.open()
    began = time.monotonic()
    shots = [shot for _ in range(6) if (shot := source.read(1.0)) is not None]
    with pytest.raises(EndOfImages):
        source.read(1.0)
    source.close()
    assert [round(int(shot.pixels.mean()) / 40) for shot in shots] == list(range(6))
    assert shots[-1].arrived - began >= 0.099  # five periods of 20 ms


class Hands:
    """A clock that stands still but for what sleeps."""

    now = 100.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


def test_a_folder_is_played_at_its_rate_whatever_held_it_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for number in range(4):
        cv2.imwrite(str(tmp_path / f"{number}.png"), picture(20 * number))
    hands = Hands()
    monkeypatch.setattr(sources, "time", hands)
    source = source_of(CameraSection(source=f"folder:{tmp_path}", fps=20, loop=True))
    source.open()
    arrivals = []
    for held_up in (0.0, 0.0, 0.0, 0.0, 0.07, 0.0, 7.0, 0.0):
        hands.now += held_up
        shot = source.read(1.0)
        arrivals.append(shot.arrived - 100.0)
    source.close()
    assert arrivals == pytest.approx([0.0, 0.05, 0.1, 0.15, 0.22, 0.25, 7.25, 7.3])


@pytest.fixture
def session() -> Iterator[zenoh.Session]:
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("listen/endpoints", "[]")
    opened = zenoh.open(config)
    yield opened
    opened.close()


def frame(image: np.ndarray, sequence: int, **fields: object) -> CameraFrame:
    base: dict[str, object] = {
        "sequence": sequence,
        "width": image.shape[1],
        "height": image.shape[0],
        "coding": "gray8",
        "stamp": Clock().stamp(),
        "pixels": image.tobytes(),
    }
    return CameraFrame.model_validate(base | fields)


def test_images_from_the_bus_keep_their_capture_time(session: zenoh.Session) -> None:
    cfg = CameraSection(source="zenoh:test/camera/image")
    slot: NewestSlot[CameraImage] = NewestSlot()
    stream = CameraStream(cfg, source_of(cfg, lambda: session), slot)
    stream.start()
    wait_for_status(stream, lambda s: s.state is EyeState.OK)
    taken = time.monotonic() - 0.123
    sent = frame(picture(77), 5, stamp=Clock().stamp(taken))
    session.put("test/camera/image", encode(sent))
    image = slot.take(PATIENCE)
    assert image.captured_at == pytest.approx(taken, abs=1e-6)
    assert image.stamped_by == "header"
    np.testing.assert_array_equal(image.pixels, picture(77))

    session.put("test/camera/image", b"\xc1 not msgpack")
    jpeg, width, height = encode_jpeg(picture(150), 90, 64)
    taken_wall = time.time() - 0.2
    taken_there = Stamp(monotonic=0.0, wall=taken_wall, boot="another")
    earliest = time.monotonic() - (time.time() - taken_wall)
    session.put(
        "test/camera/image",
        encode(
            frame(
                picture(),
                8,
                coding="jpeg",
                pixels=jpeg,
                width=width,
                height=height,
                stamp=taken_there,
            )
        ),
    )
    image = slot.take(PATIENCE)
    assert abs(int(image.pixels.mean()) - 150) <= 1
    latest = taken_wall - time.time() + time.monotonic()
    assert min(earliest, latest) - 0.01 <= image.captured_at <= max(earliest, latest) + 0.01
    assert stream.status().lost == 2  # 6 and 7
    stream.stop()


SECRET = "known to the camera's machine"


def test_images_without_the_secret_displace_none_and_are_counted_and_named(
    session: zenoh.Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sources, "STRANGERS_LOOK", 0.0)
    file, key = tmp_path / "image.key", "test/signed/image"
    file.write_text(f"{SECRET}\n", encoding="utf-8")
    cfg = CameraSection(source=f"zenoh:{key}", secret_file=file)
    slot: NewestSlot[CameraImage] = NewestSlot()
    stream = CameraStream(cfg, source_of(cfg, lambda: session), slot)
    stream.start()
    wait_for_status(stream, lambda s: s.state is EyeState.OK)
    forged, private = encode(frame(picture(200), 1_000_000)), private_key(SECRET, key)
    for pattern in (key, "test/signed/**", "**", f"{key}/*"):
        session.put(pattern, forged, attachment=sign(SECRET, key, forged))
    status = wait_for_status(stream, lambda s: s.damaged > 0)
    assert "without the secret" in status.damage
    session.put(private, forged)  # from who heard of the key and has no secret
    session.put(private, forged, attachment=bytes(32))
    own = encode(frame(picture(77), 5))
    session.put(private, own, attachment=sign(SECRET, key, own))
    image = slot.take(PATIENCE)
    np.testing.assert_array_equal(image.pixels, picture(77))
    assert stream.status().images == 1
    assert stream.status().lost == 0
    stream.stop()


@pytest.mark.parametrize(
    ("text", "words"), [(None, "No such file"), ("short", "5 characters"), (b"\xff" * 20, "UTF-8")]
)
def test_a_secret_of_images_that_is_none_is_a_wrong_configuration(
    tmp_path: Path, text: str | bytes | None, words: str
) -> None:
    file = tmp_path / "image.key"
    if text is not None:
        file.write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(ConfigError, match=words):
        CameraSection(source="zenoh:mk/mk1/sim/camera/down", secret_file=file).image_secret()


def test_rubbish_on_an_image_key_is_named(session: zenoh.Session) -> None:
    cfg = CameraSection(source="zenoh:test/rubbish/image", silent_after=0.05)
    slot: NewestSlot[CameraImage] = NewestSlot()
    stream = CameraStream(cfg, source_of(cfg, lambda: session), slot)
    stream.start()
    wait_for_status(stream, lambda s: s.state in (EyeState.OK, EyeState.SILENT))
    session.put("test/rubbish/image", b"hello")
    status = wait_for_status(stream, lambda s: s.state is EyeState.SILENT and "not an image" in s.reason)
    assert status.images == 0
    stream.stop()


class FakeDriver:
    """A driver that takes some settings and delivers two images before it is pulled out."""

    def __init__(self, taken: dict[int, float]) -> None:
        self._taken = taken
        self._values: dict[int, float] = {cv2.CAP_PROP_POS_MSEC: 123_456.5}
        self._images = [picture(10), picture(20)]
        if taken.get(cv2.CAP_PROP_FOURCC) == cv2.VideoWriter.fourcc(*"MJPG"):
            jpegs = [cv2.imencode(".jpg", image)[1].reshape(1, -1) for image in self._images]
            self._images = [np.hstack([jpeg, np.zeros((1, 700), np.uint8)]) for jpeg in jpegs]  # the driver's buffer
            self._values[cv2.CAP_PROP_FOURCC] = taken[cv2.CAP_PROP_FOURCC]
        self.released = False

    def set(self, control: int, value: float) -> bool:
        self._values[control] = self._taken.get(control, value)
        return True

    def get(self, control: int) -> float:
        return self._values.get(control, 0.0)

    def read(self) -> tuple[bool, np.ndarray | None]:
        return (True, self._images.pop(0)) if self._images else (False, None)

    def isOpened(self) -> bool:  # OpenCV's name
        return True

    def release(self) -> None:
        self.released = True


def test_a_device_of_others_and_a_device_that_is_no_camera_are_told_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = tmp_path / "video0"
    device.touch()
    monkeypatch.setattr(cv2.videoio_registry, "hasBackend", lambda _: True)
    source = source_of(CameraSection(source=f"v4l2:{device}"))
    with pytest.raises(VisionError, match="does another program hold it"):
        source.open()
    monkeypatch.setattr("os.access", lambda *_: False)
    with pytest.raises(VisionError, match="join the group video"):
        source.open()


def test_a_driver_is_told_its_settings_and_what_it_refuses_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = FakeDriver({cv2.CAP_PROP_FRAME_WIDTH: 800.0, cv2.CAP_PROP_FRAME_HEIGHT: 600.0})
    monkeypatch.setattr(cv2, "VideoCapture", lambda *_: driver)
    monkeypatch.setattr(cv2.videoio_registry, "hasBackend", lambda _: True)
    device = tmp_path / "video0"
    device.touch()
    cfg = CameraSection(source=f"v4l2:{device}", width=1280, height=720, fps=60, exposure_ms=4.0, gain=12)
    source = source_of(cfg)
    refused = source.open()
    assert refused == ("width=1280: the driver has 800", "height=720: the driver has 600")
    assert driver.get(cv2.CAP_PROP_AUTO_EXPOSURE) == 1  # V4L2: manual
    assert driver.get(cv2.CAP_PROP_EXPOSURE) == 40  # V4L2 counts 100 us
    assert (driver.get(cv2.CAP_PROP_GAIN), driver.get(cv2.CAP_PROP_FPS)) == (12, 60)
    shots = [source.read(1.0), source.read(1.0)]
    assert [shot.stamp for shot in shots if shot is not None] == [123.4565, 123.4565]
    with pytest.raises(VisionError, match="gives no more images"):
        source.read(1.0)
    source.close()
    assert driver.released


def test_motion_jpeg_of_a_device_is_taken_undecoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    driver = FakeDriver({cv2.CAP_PROP_FOURCC: cv2.VideoWriter.fourcc(*"MJPG")})
    monkeypatch.setattr(cv2, "VideoCapture", lambda *_: driver)
    monkeypatch.setattr(cv2.videoio_registry, "hasBackend", lambda _: True)
    device = tmp_path / "video0"
    device.touch()
    source = source_of(CameraSection(source=f"v4l2:{device}"))
    source.open()
    assert driver.get(cv2.CAP_PROP_CONVERT_RGB) == 0
    shot = source.read(1.0)
    np.testing.assert_array_equal(shot.pixels, picture(10))


def test_a_clip_that_loops_begins_again(tmp_path: Path) -> None:
    source = source_of(CameraSection(source=f"file:{clip_of(tmp_path, 3)}", loop=True, paced=False))
    source.open()
    shots = [shot for _ in range(7) if (shot := source.read(1.0)) is not None]
    source.close()
    assert [round(int(shot.pixels.mean()) / 40) for shot in shots] == [0, 1, 2, 0, 1, 2, 0]
