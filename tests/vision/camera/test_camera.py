"""A camera's life: streaming, unplugged and back, silent, at its end; stamps; what each source gives."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
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

    def __init__(self, *script: str) -> None:
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
        match next(self.script, ""):
            case "image":
                return Shot(picture(), time.monotonic(), None)
            case "unplug":
                self.missing = True
                raise VisionError("camera test: /dev/video7 gives no more images")
            case "damaged":
                raise PictureError("damaged JPEG: premature end of data segment")
            case "fault":
                raise OSError(5, "Input/output error")
            case "end":
                raise EndOfImages
        self.drained.set()
        threading.Event().wait(timeout)
        return None

    def close(self) -> None:
        pass


@contextmanager
def streamed(source: ImageSource, **options: object) -> Iterator[tuple[CameraStream, NewestSlot[CameraImage]]]:
    """A stream of a source, with the slot of its images."""
    cfg = {"name": "test", "source": "scripted", "reopen_min": 0.01, "reopen_max": 0.02, "silent_after": PATIENCE}
    slot: NewestSlot[CameraImage] = NewestSlot()
    stream = CameraStream(CameraSection.model_validate(cfg | options), source, slot)
    stream.start()
    yield stream, slot
    stream.stop()


def absent(self: object) -> tuple[str, ...]:
    raise VisionError("camera test: not there")


def test_an_unplugged_camera_is_named_and_comes_back() -> None:
    source = Scripted("image", "fault", "image", "unplug", "image")
    with streamed(source) as (stream, slot):
        assert source.drained.wait(PATIENCE)
        status = wait_for_status(stream, lambda s: s.images == 3)
        assert status.state is EyeState.OK
        assert status.settings_refused == ("gain=3: the driver has 1",)
        assert (source.opened, status.reopened) == (4, 3)  # the driver raised, lost, missing once, back
        image = slot.take(0.0)
        assert (image.sequence, image.camera, image.stamped_by) == (3, "test", "arrival")
        assert slot.dropped["test"] == 2


def test_a_camera_with_nothing_but_damaged_images_says_what_is_wrong_with_them() -> None:
    source = Scripted("image", *["damaged"] * 4)
    with streamed(source, silent_after=0.02) as (stream, _):
        assert source.drained.wait(PATIENCE)
        status = wait_for_status(stream, lambda s: s.state is EyeState.SILENT)
        assert (status.reason, status.damaged, status.images) == ("damaged JPEG: premature end of data segment", 4, 1)
        assert source.opened == 1


def test_a_camera_without_images_is_silent_then_streaming_again() -> None:
    gate, source = threading.Event(), Scripted("image")
    silent = source.read
    source.read = lambda timeout: Shot(picture(), time.monotonic()) if gate.is_set() else silent(timeout)
    with streamed(source, silent_after=0.05) as (stream, _):
        status = wait_for_status(stream, lambda s: s.state is EyeState.SILENT)
        assert "no image for" in status.reason
        assert status.fps == 0.0
        gate.set()
        wait_for_status(stream, lambda s: s.state is EyeState.OK)


def test_the_pause_before_a_camera_is_opened_again_doubles_to_the_longest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Scripted, "open", absent)
    cfg = CameraSection(source="/dev/video7", reopen_min=0.2, reopen_max=1.0)
    stream, pauses = CameraStream(cfg, Scripted(), NewestSlot[CameraImage]()), []

    def wait(pause: float) -> None:
        pauses.append(round(pause, 3))
        if len(pauses) == 5:
            stream.stop()

    monkeypatch.setattr(stream._stop, "wait", wait)
    stream._run()
    assert pauses == [0.2, 0.4, 0.8, 1.0, 1.0]


def test_on_another_clock_the_smallest_delay_is_the_offset() -> None:
    clock, rng = StampClock(), np.random.default_rng(3)
    errors, knew = [], []
    for k in range(400):
        taken = 1000.0 + k / 30.0
        stamp, by = clock.stamp(taken - 990.0, taken + 0.04 + float(rng.exponential(0.01)))
        errors.append(stamp - taken - 0.04)
        knew.append(by)
    assert set(knew[:50]) == {"arrival"}, "not before its clock was seen to run as ours"
    assert set(knew[80:]) == {"driver"}
    assert 0.0 <= max(errors[80:]) < 0.001  # the constant 40 ms cannot be seen, the jitter is gone
    assert clock.stamp(0.5, 1100.0) == (pytest.approx(1100.0), "arrival"), "it was restarted"


@pytest.mark.parametrize("true_hz", [10.0, 24.0, 26.0])
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


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("v4l2:/dev/video99", "/dev/video99 is not there"),
        ("file:missing.avi", "no such file: missing.avi"),
        ("folder:missing", "no such folder: missing"),
        ("http://127.0.0.1:1/none", "FFMPEG cannot open http.*: check address"),
        ("gstreamer:nosuchelement", r"built without GSTREAMER|GSTREAMER cannot open nosuchelement"),
        ("zenoh:key", "needs the bus"),
        ("webcam", "camera down: source"),
    ],
)
def test_a_source_that_is_not_there_says_so(source: str, words: str) -> None:
    with pytest.raises(ConfigError if source == "webcam" else VisionError, match=words):
        source_of(CameraSection(source=source, reopen_max=0.3)).open()


def test_a_folder_is_shown_in_natural_order_to_its_end(tmp_path: Path) -> None:
    for number in (10, 2, 1):
        cv2.imwrite(str(tmp_path / f"image{number}.png"), picture(20 * number))
    (tmp_path / "image3.png").write_bytes(b"no picture")
    (tmp_path / "notes.txt").write_text("ignored")
    assert [path.stem for path in list_pictures(tmp_path)] == ["image1", "image2", "image3", "image10"]
    cfg = CameraSection(source=f"folder:{tmp_path}", paced=False)
    with streamed(source_of(cfg), paced=False) as (stream, slot):
        seen = [image for _ in range(3) if (image := slot.take(PATIENCE)) is not None]
        assert [int(image.pixels[0, 0]) for image in seen] == [20, 40, 200]
        wait_for_status(stream, lambda s: s.state is EyeState.ENDED)
        assert slot.dropped.total() == 0


@pytest.mark.parametrize(("is_endless", "shown"), [(False, [0, 1, 2, 3, 4, 5]), (True, [0, 1, 2, 3, 4, 5, 0, 1])])
def test_a_clip_is_played_at_its_own_rate_to_its_end_or_again(tmp_path: Path, is_endless: bool, shown) -> None:
    """A clip of 50 pictures a second, each brighter than the one before by 40."""
    path = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 50.0, (64, 48), isColor=False)
    for k in range(6):
        writer.write(picture(40 * k))
    writer.release()
    source = source_of(CameraSection(source=f"file:{path}", loop=is_endless, paced=not is_endless))
    source.open()
    began = time.monotonic()
    shots = [source.read(1.0) for _ in shown]
    assert [round(int(shot.pixels.mean()) / 40) for shot in shots] == shown
    if not is_endless:
        with pytest.raises(EndOfImages):
            source.read(1.0)
        assert shots[-1].arrived - began >= 0.099  # five periods of 20 ms
    source.close()


@pytest.fixture
def session() -> Iterator[zenoh.Session]:
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("listen/endpoints", "[]")
    opened = zenoh.open(config)
    yield opened
    opened.close()


def frame(image: np.ndarray, sequence: int, **fields: object) -> bytes:
    """An image as it crosses the bus."""
    height, width = image.shape
    base = {"width": width, "height": height, "coding": "gray8", "stamp": Clock().stamp(), "pixels": image.tobytes()}
    return encode(CameraFrame.model_validate(base | {"sequence": sequence} | fields))


def test_images_from_the_bus_keep_their_capture_time_and_rubbish_is_named(session: zenoh.Session) -> None:
    key = "test/camera/image"
    source = source_of(CameraSection(source=f"zenoh:{key}"), lambda: session)
    with streamed(source, silent_after=0.3) as (stream, slot):
        wait_for_status(stream, lambda s: s.state in (EyeState.OK, EyeState.SILENT))
        session.put(key, b"hello")
        status = wait_for_status(stream, lambda s: s.state is EyeState.SILENT and "not an image" in s.reason)
        assert status.images == 0
        taken = time.monotonic() - 0.123
        session.put(key, frame(picture(77), 5, stamp=Clock().stamp(taken)))
        image = slot.take(PATIENCE)
        assert image.captured_at == pytest.approx(taken, abs=1e-6)
        assert image.stamped_by == "header"
        np.testing.assert_array_equal(image.pixels, picture(77))
        session.put(key, b"\xc1 not msgpack")
        jpeg, width, height = encode_jpeg(picture(150), 90, 64)
        coded = {"coding": "jpeg", "pixels": jpeg, "width": width, "height": height}
        wall = time.time() - 0.2
        earliest = time.monotonic() - (time.time() - wall)
        session.put(key, frame(picture(), 8, stamp=Stamp(monotonic=0.0, wall=wall, boot="another"), **coded))
        image = slot.take(PATIENCE)
        assert abs(int(image.pixels.mean()) - 150) <= 1
        latest = wall - time.time() + time.monotonic()
        assert min(earliest, latest) - 0.01 <= image.captured_at <= max(earliest, latest) + 0.01
        assert stream.status().lost == 2  # 6 and 7


SECRET = "known to the camera's machine"


def test_images_without_the_secret_displace_none_and_are_counted_and_named(
    session: zenoh.Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sources, "STRANGERS_LOOK", 0.0)
    file, key = tmp_path / "image.key", "test/signed/image"
    file.write_text(f"{SECRET}\n", encoding="utf-8")
    source = source_of(CameraSection(source=f"zenoh:{key}", secret_file=file), lambda: session)
    with streamed(source) as (stream, slot):
        wait_for_status(stream, lambda s: s.state is EyeState.OK)
        forged, private = frame(picture(200), 1_000_000), private_key(SECRET, key)
        for pattern in (key, "test/signed/**", "**", f"{key}/*"):
            session.put(pattern, forged, attachment=sign(SECRET, key, forged))
        status = wait_for_status(stream, lambda s: s.damaged > 0)
        assert "without the secret" in status.damage
        session.put(private, forged)  # from who heard of the key and has no secret
        session.put(private, forged, attachment=bytes(32))
        own = frame(picture(77), 5)
        session.put(private, own, attachment=sign(SECRET, key, own))
        np.testing.assert_array_equal(slot.take(PATIENCE).pixels, picture(77))
        assert (stream.status().images, stream.status().lost) == (1, 0)


@pytest.mark.parametrize(
    ("text", "words"), [(None, "No such file"), (b"short", "5 characters"), (b"\xff" * 20, "UTF-8")]
)
def test_a_secret_of_images_that_is_none_is_a_wrong_configuration(tmp_path: Path, text: bytes | None, words) -> None:
    file = tmp_path / "image.key"
    if text is not None:
        file.write_bytes(text)
    with pytest.raises(ConfigError, match=words):
        CameraSection(source="zenoh:mk/mk1/sim/camera/down", secret_file=file).image_secret()


@pytest.fixture
def device(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A device that OpenCV has a backend for."""
    monkeypatch.setattr(cv2.videoio_registry, "hasBackend", lambda _: True)
    (tmp_path / "video0").touch()
    return tmp_path / "video0"


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


def test_a_device_of_others_and_a_device_that_is_no_camera_are_told_apart(device: Path, monkeypatch) -> None:
    source = source_of(CameraSection(source=f"v4l2:{device}"))
    with pytest.raises(VisionError, match="does another program hold it"):
        source.open()
    monkeypatch.setattr("os.access", lambda *_: False)
    with pytest.raises(VisionError, match="join the group video"):
        source.open()


def test_a_driver_is_told_its_settings_and_what_it_refuses_is_named(device: Path, monkeypatch) -> None:
    driver = FakeDriver({cv2.CAP_PROP_FRAME_WIDTH: 800.0, cv2.CAP_PROP_FRAME_HEIGHT: 600.0})
    monkeypatch.setattr(cv2, "VideoCapture", lambda *_: driver)
    cfg = CameraSection(source=f"v4l2:{device}", width=1280, height=720, fps=60, exposure_ms=4.0, gain=12)
    source = source_of(cfg)
    assert source.open() == ("width=1280: the driver has 800", "height=720: the driver has 600")
    assert driver.get(cv2.CAP_PROP_AUTO_EXPOSURE) == 1  # V4L2: manual
    assert driver.get(cv2.CAP_PROP_EXPOSURE) == 40  # V4L2 counts 100 us
    assert (driver.get(cv2.CAP_PROP_GAIN), driver.get(cv2.CAP_PROP_FPS)) == (12, 60)
    assert [source.read(1.0).stamp for _ in range(2)] == [123.4565, 123.4565]
    with pytest.raises(VisionError, match="gives no more images"):
        source.read(1.0)
    source.close()
    assert driver.released
