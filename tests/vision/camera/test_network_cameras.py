"""Network cameras through FFmpeg: images come, the camera may go and return, and its stamps are what they are."""

from __future__ import annotations

from threading import Event

import pytest

from mkdaemon.config.camera import CameraSection
from mkdaemon.telemetry.vision import EyeState
from mkdaemon.vision.camera.camera import CameraStream
from mkdaemon.vision.camera.image import CameraImage, NewestSlot
from mkdaemon.vision.camera.sources import source_of
from tests.bus.support import free_endpoint
from tests.vision.camera.network_cameras import HEIGHT, WIDTH, HttpCamera, NetworkCamera, RtspCamera, jpeg
from tests.vision.streams import wait_for_status

PATIENCE = 60.0


def watch(address: str) -> tuple[CameraStream, NewestSlot[CameraImage]]:
    cfg = CameraSection(source=address, reopen_min=0.05, reopen_max=5.0)
    slot: NewestSlot[CameraImage] = NewestSlot()
    stream = CameraStream(cfg, source_of(cfg), slot)
    stream.start()
    return stream, slot


@pytest.mark.parametrize("kind", [HttpCamera, RtspCamera])
def test_a_network_camera_is_seen_lost_and_found_again(kind: type[NetworkCamera]) -> None:
    port = int(free_endpoint().rpartition(":")[2])  # nobody takes it while the camera is gone
    with kind(0.02, port) as camera:
        address = camera.address
        stream, slot = watch(address)
        status = wait_for_status(stream, lambda s: s.images >= 5)
        assert (status.width, status.height) == (WIDTH, HEIGHT)
        image = slot.take(PATIENCE)
        grey = int(image.pixels.mean())
        assert min(abs(grey - 40 - 10 * number) for number in range(20)) <= 2
    status = wait_for_status(stream, lambda s: s.state is EyeState.GONE)
    assert address in status.reason
    seen = status.images
    with kind(0.02, port):
        wait_for_status(stream, lambda s: s.state is EyeState.OK and s.images > seen)
        stream.stop()


def test_http_images_are_stamped_by_their_arrival_whatever_ffmpeg_counts() -> None:
    with HttpCamera(0.1) as camera:  # FFmpeg counts 25 a second
        stream, slot = watch(camera.address)
        ages = []
        while len(ages) < 30:
            image = slot.take(PATIENCE)
            ages.append(image.received_at - image.captured_at)
            assert image.stamped_by == "arrival"
        stream.stop()
    assert ages == [0.0] * len(ages)


def test_a_stream_that_changes_size_is_handed_on_as_it_is_not_scaled() -> None:
    changed = Event()
    with HttpCamera(
        0.02, picture=lambda n: jpeg(n, WIDTH // 2, HEIGHT // 2) if changed.is_set() else jpeg(n)
    ) as camera:
        stream, _ = watch(camera.address)
        wait_for_status(stream, lambda s: s.width == WIDTH)
        changed.set()
        status = wait_for_status(stream, lambda s: s.width != WIDTH)
        assert (status.width, status.height) == (WIDTH // 2, HEIGHT // 2)
        stream.stop()


def test_a_damaged_image_of_a_stream_is_counted_named_and_not_handed_on() -> None:
    with HttpCamera(0.02, picture=lambda n: jpeg(n)[:-40] + jpeg(n)[-2:] if n % 2 else jpeg(n)) as camera:
        stream, _ = watch(camera.address)
        status = wait_for_status(stream, lambda s: s.damaged >= 3 and s.images >= 3)
        assert "damaged JPEG" in status.damage
        assert status.state is EyeState.OK
        stream.stop()
