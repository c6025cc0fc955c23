"""Where images come from: a driver, a network stream, a clip, a folder, a Zenoh key. One interface for all."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, Final

import cv2
import zenoh

from mkdaemon.clock import Clock
from mkdaemon.config.camera import CameraSection
from mkdaemon.errors import ConfigError, VisionError
from mkdaemon.telemetry.signature import Signature, private_key
from mkdaemon.vision.camera.capture import CLIPS, StreamSource, open_clip
from mkdaemon.vision.camera.image import EndOfImages, PictureError, Recorded, Shot, Source
from mkdaemon.vision.camera.imagecodec import read_picture, unpack
from mkdaemon.vision.camera.slot import NewestSlot

STRANGERS_LOOK: Final = 1.0
"""Time between two looks for images of somebody else [s]."""
PICTURES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".pgm"})
FOLDER_HZ = 10.0
LATEST: Final = 1.0
"""A recorded picture that is later is due at once, and the next ones follow it [s]."""
SCHEMES: Final = ("zenoh", "folder", "file", "gstreamer", "v4l2", "rtsp", "rtsps", "http", "https", "udp")


def source_of(cfg: CameraSection, session: Callable[[], zenoh.Session] | None = None) -> Source:
    """Choose the source a configuration names; `session` gives the Zenoh session for `zenoh:` sources.

    Raises:
        ConfigError: nothing is known about such a source.
    """
    text = cfg.source
    scheme, _, rest = text.partition(":")
    if not rest or scheme not in SCHEMES:
        path = Path(text)
        is_device, is_clip = re.fullmatch(r"/dev/[\w/.:-]+", text), path.suffix.lower() in CLIPS
        scheme = "v4l2" if is_device else "folder" if path.is_dir() else "file" if is_clip else ""
        rest = text
    match scheme:
        case "zenoh" if session is not None:
            return ZenohSource(rest, session, cfg.image_secret())
        case "zenoh":
            msg = f"camera {cfg.name}: source '{text}' needs the bus; run it in the daemon"
        case "folder":
            return PlayedSource(partial(open_folder, Path(rest), cfg.fps or FOLDER_HZ), cfg)
        case "file":
            return PlayedSource(partial(open_clip, Path(rest)), cfg)
        case "gstreamer" | "v4l2":
            return StreamSource(rest, cv2.CAP_V4L2 if scheme == "v4l2" else cv2.CAP_GSTREAMER, cfg)
        case "":
            msg = (
                f"camera {cfg.name}: source '{text}' is none of /dev/videoN, v4l2:PATH, rtsp://..., gstreamer:PIPELINE,"
                " file:CLIP, folder:DIR, zenoh:KEY"
            )
        case _:
            return StreamSource(text, cv2.CAP_FFMPEG, cfg)
    raise ConfigError(msg)


class ZenohSource:
    """Images from a key on the bus: another machine's camera, or the simulator's.

    Args:
        key: plain and whole.
        session: gives an open one.
        secret: with which the sender signs them, and without which nobody knows the key they come to; None takes
            images from whoever puts them.
    """

    live = True

    def __init__(self, key: str, session: Callable[[], zenoh.Session], secret: str | None = None) -> None:
        self._key, self._session, self._secret = key, session, secret
        self._clock = Clock()
        self._subscriber: zenoh.Subscriber[None] | None = None
        self._strangers: zenoh.Subscriber[Any] | None = None
        self._newest: NewestSlot[tuple[bytes, float]] = NewestSlot()
        self._look_at = 0.0

    def open(self) -> tuple[str, ...]:
        """Subscribe with a direct callback that only keeps the newest payload."""
        try:
            session, secret = self._session(), self._secret
            key = self._key if secret is None else private_key(secret, self._key)
            self._subscriber = session.declare_subscriber(key, zenoh.handlers.Callback(self._on_sample, indirect=False))
            if secret is not None:  # kept without Python, the newest alone
                self._strangers = session.declare_subscriber(self._key, zenoh.handlers.RingChannel(1))
        except zenoh.ZError as error:
            msg = f"zenoh:{self._key}: {str(error).partition(' at ')[0]}"
            raise VisionError(msg) from error
        return ()

    def _on_sample(self, sample: zenoh.Sample) -> None:
        payload, proof = sample.payload.to_bytes(), sample.attachment
        if self._secret is not None:
            signature = Signature(self._key, payload, b"" if proof is None else proof.to_bytes())
            if not signature.is_by(self._secret):
                return
        self._newest.put((payload, time.monotonic()))

    def read(self, timeout: float) -> Shot | None:
        """Newest image; a PictureError, once a second at most, where somebody put one to the plain key."""
        if self._strangers is not None and time.monotonic() >= self._look_at:
            self._look_at = time.monotonic() + STRANGERS_LOOK
            if self._strangers.handler.try_recv() is not None:
                msg = f"somebody without the secret of this camera puts images to {self._key}: they are not looked at"
                raise PictureError(msg)
        taken = self._newest.take(timeout)
        if taken is None:
            return None
        payload, arrived = taken
        frame, pixels = unpack(payload)
        return Shot(pixels, arrived, self._clock.monotonic_of(frame.stamp), "header", frame.sequence)

    def close(self) -> None:
        """End the subscriptions."""
        for subscriber in filter(None, (self._strangers, self._subscriber)):
            subscriber.undeclare()  # type: ignore[no-untyped-call]
        self._strangers = self._subscriber = None


class PlayedSource:
    """Recorded pictures, each so long after the one before as it was taken: a clip, or the pictures of a folder.

    Args:
        record: opens it; raises VisionError where it cannot be read.
        cfg: whether it is paced, and begins again at its end.
    """

    live = False

    def __init__(self, record: Callable[[], Iterator[Recorded]], cfg: CameraSection) -> None:
        self._record, self._cfg = record, cfg
        self._pictures: Iterator[Recorded] = iter(())
        self._due = -math.inf

    def open(self) -> tuple[str, ...]:
        """Begin at its first picture."""
        self._pictures, self._due = self._record(), -math.inf
        return ()

    def read(self, timeout: float) -> Shot | None:
        """Next picture, in time."""
        picture = next(self._pictures, None)
        if picture is None and self._cfg.loop:
            self._pictures = self._record()
            picture = next(self._pictures, None)
        if picture is None:
            raise EndOfImages
        if self._cfg.paced:
            due, now = self._due + picture.pause, time.monotonic()
            self._due = due if due > now - LATEST else now
            time.sleep(max(self._due - now, 0.0))
        return Shot(picture.decode(), time.monotonic())

    def close(self) -> None:
        """Let go of the file."""
        self._pictures = iter(())


def open_folder(path: Path, hz: float) -> Iterator[Recorded]:
    """The pictures of a folder; see `list_pictures`."""
    return (Recorded(1.0 / hz, partial(read_picture, file)) for file in list_pictures(path))


def list_pictures(folder: Path) -> list[Path]:
    """Pictures of a folder in natural order (2 before 10).

    Raises:
        VisionError: no such folder, or no picture in it.
    """
    if not folder.is_dir():
        msg = f"no such folder: {folder}"
        raise VisionError(msg)
    found = [path for path in folder.iterdir() if path.suffix.lower() in PICTURES]
    if not found:
        msg = f"no pictures in {folder}: put {', '.join(sorted(PICTURES))} files there"
        raise VisionError(msg)
    return sorted(
        found, key=lambda path: [int(t) if t.isdecimal() else t for t in re.split(r"(\d+)", path.name.lower())]
    )
