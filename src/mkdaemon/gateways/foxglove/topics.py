"""The table of topics: which keys make which topic, with which schema, by which conversion.

A further topic is one row. Every other key is shown as JSON, under its own name.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final, Protocol

import foxglove.messages as fg
from foxglove import Schema
from pydantic_core import to_json

from mkdaemon.client.samples import carried_schemas, viewer_schema, viewer_value
from mkdaemon.gateways.foxglove import diagnostics, messages
from mkdaemon.gateways.foxglove.names import Names
from mkdaemon.gateways.foxglove.scene import VehicleScene
from mkdaemon.gateways.foxglove.whereabouts import PLACE_KEYS, FrameTree, Poses
from mkdaemon.gateways.keys import matches
from mkdaemon.telemetry.base import Stamped

CAMERA: Final = "<camera>"
"""Stands for the name of a camera, in keys and topics; such a topic is there once for each camera."""

Conversion = Callable[[str, Stamped], bytes | None]
"""Makes the message of a key and its value; None where the value makes none. It may know what came before."""


class _Encodable(Protocol):
    def encode(self) -> bytes: ...


@dataclass(frozen=True, slots=True)
class FoxgloveTopic:
    """One topic.

    Attributes:
        name: with a slash before it.
        keys: patterns of keys that it is made of, without `mk/<vehicle>/`.
        encoding: of its messages: `protobuf` or `json`.
        schema: makes their schema.
        convert: makes the conversion for one vehicle; None for a key that is shown as JSON.
    """

    name: str
    keys: tuple[str, ...]
    encoding: str
    schema: Callable[[], Schema]
    convert: Callable[[Names], Conversion] | None

    @property
    def is_of_a_camera(self) -> bool:
        """It is there once for each camera."""
        return CAMERA in self.name

    def of(self, camera: str) -> FoxgloveTopic:
        """The topic of one camera."""
        keys = tuple(key.replace(CAMERA, camera) for key in self.keys)
        return replace(self, name=self.name.replace(CAMERA, camera), keys=keys)

    def takes(self, suffix: str) -> bool:
        """Whether it is made of a key."""
        return any(matches(key, suffix) for key in self.keys)

    def conversion(self, names: Names) -> Conversion | None:
        """A conversion that has seen nothing yet; None for JSON."""
        return None if self.convert is None else self.convert(names)


def _each(convert: Callable[[Names, Any], _Encodable | None]) -> Callable[[Names], Conversion]:
    """A conversion that makes each message of one value alone."""

    def of(names: Names) -> Conversion:
        def one(suffix: str, value: Stamped) -> bytes | None:
            message = convert(names, value)
            return None if message is None else message.encode()

        return one

    return of


def _typed(name: str, keys: tuple[str, ...], message: Any, convert: Callable[[Names], Conversion]) -> FoxgloveTopic:
    """A topic with one of Foxglove's own schemas."""
    return FoxgloveTopic(name, keys, "protobuf", message.get_schema, convert)


_SETUP: Final = "vision/*/setup"

TOPICS: Final[tuple[FoxgloveTopic, ...]] = (
    _typed("/scene", (*PLACE_KEYS, _SETUP, "control/error", "control/fence"), fg.SceneUpdate, VehicleScene),
    _typed("/tf", (*PLACE_KEYS, _SETUP), fg.FrameTransforms, FrameTree),
    _typed("/pose", PLACE_KEYS, fg.PoseInFrame, Poses),
    _typed("/fix", ("state/position",), fg.LocationFix, _each(messages.location_fix)),
    _typed("/home", ("state/position",), fg.LocationFix, messages.HomeAnnouncer),
    _typed("/log", ("event/*",), fg.Log, _each(messages.log_line)),
    FoxgloveTopic(
        *("/diagnostics", diagnostics.KEYS, "json", diagnostics.schema),
        diagnostics.Diagnostics,
    ),
    *(
        _typed(f"/camera/{CAMERA}/{word}", (f"vision/{CAMERA}/{key}",), message, _each(convert))
        for word, key, message, convert in (
            ("image", "image", fg.CompressedImage, messages.compressed_image),
            ("calibration", "setup", fg.CameraCalibration, messages.camera_calibration),
            ("annotations", "tags", fg.ImageAnnotations, messages.tag_annotations),
            ("pose", "pose", fg.PoseInFrame, messages.seen_pose),
        )
    ),
)
"""Every topic with a schema that viewers know."""

SHOWN_OTHERWISE: Final = frozenset({"tf", "vision/<camera>/image"})
"""Keys that are no topic of JSON: /tf and /camera/<camera>/image show them."""


def json_keys() -> Iterator[tuple[str, str]]:
    """Every key that is shown as JSON, with the name of its schema; names of cameras as `<camera>`.

    Keys with another open part are left out: frames are found as they come, and what other programs put under names of
    their own (`joy/<pad>`, `sim/camera/<name>`) is not looked for.
    """
    for suffix, schema in carried_schemas():
        if "<" not in suffix.replace(CAMERA, "") and suffix not in SHOWN_OTHERWISE:
            yield suffix, schema


def json_topic(key: str, schema: str | None) -> FoxgloveTopic:
    """The topic of a key that is shown as JSON, from the name of its schema."""
    return FoxgloveTopic(f"/{key}", (key,), "json", partial(json_schema, schema), None)


def topics_of(camera: str = "") -> Iterator[FoxgloveTopic]:
    """Every topic that each vehicle has, or, given its name, that each camera has."""
    for topic in (*TOPICS, *(json_topic(key, schema) for key, schema in json_keys())):
        if topic.is_of_a_camera == bool(camera):
            yield topic.of(camera)


def json_schema(name: str | None) -> Schema:
    """The schema of a key as viewers can read it; one without fields where it is not known here.

    Args:
        name: name and version, for example `Attitude.v1`.
    """
    data = viewer_schema(name or "")
    if data is None:
        return Schema(name="mk.unknown", encoding="jsonschema", data=b'{"type": "object"}')
    return Schema(name=f"mk.{name}", encoding="jsonschema", data=data)


def json_message(fields: dict[str, Any]) -> bytes | None:
    """The map of a value as JSON; None where it has something that JSON has not, as strangers may put.

    Args:
        fields: as it came; `age`, which answers have and values have not, is left out.
    """
    shown = viewer_value({name: part for name, part in fields.items() if name != "age"} if "age" in fields else fields)
    try:
        message = to_json(shown, inf_nan_mode="constants")  # a third of the time of the standard library's
        if b"NaN" in message or b"Infinity" in message:  # or in a text
            json.dumps(shown, allow_nan=False)
    except ValueError:
        return None
    return message
