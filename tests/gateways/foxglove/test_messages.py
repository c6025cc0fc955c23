"""Values as Foxglove's messages, read back by the schemas they are sent with."""

from __future__ import annotations

import base64
from functools import partial

import foxglove.messages as fg
import pytest

from mkdaemon.gateways.foxglove import messages
from mkdaemon.gateways.foxglove.names import Names
from mkdaemon.reading import line_of
from tests import samples
from tests.gateways.foxglove.viewer import read
from tests.reading import events

ONE, MANY = Names("mk1"), Names("mk1", "mk1/")
position = partial(samples.position, 5.0)


def shown(convert, value, names=ONE):
    message = convert(names, value)
    return read(type(message).get_schema(), message.encode())


def test_a_position_is_a_fix_and_home_another_shown_once_and_when_it_changes():
    fix = shown(messages.location_fix, position())
    home = read(fg.LocationFix.get_schema(), messages.HomeAnnouncer(ONE)("", position()))
    assert (fix["latitude"], fix["longitude"], fix["altitude"]) == (53.2301184, 7.4590749, 12.5)
    assert (fix["frame_id"], fix["position_covariance_type"]) == ("base_link", "UNKNOWN")
    assert fix["timestamp"] == "2023-11-14T22:13:25Z"
    assert (home["latitude"], home["longitude"], home["altitude"]) == (53.23, 7.459, "NaN")
    assert shown(messages.location_fix, position(altitude=None))["altitude"] == "NaN"
    assert messages.HomeAnnouncer(ONE)("", position(home_latitude_deg=None)) is None
    show = messages.HomeAnnouncer(ONE)
    homes = [53.0, 53.0, 53.0, 53.5, 53.5, None, 53.5]
    shown_at = [n for n, one in enumerate(homes) if show("", position(home_latitude_deg=one)) is not None]
    assert shown_at == [0, 3]


def test_an_image_is_sent_as_it_came_and_grey_pixels_as_png():
    grey = shown(messages.compressed_image, samples.image(5.0, sequence=1), MANY)
    assert (grey["format"], grey["frame_id"]) == ("png", "mk1/camera/down")
    assert base64.b64decode(grey["data"]).startswith(b"\x89PNG\r\n")
    jpeg = samples.image(5.0, sequence=1).model_copy(update={"coding": "jpeg", "pixels": b"\xff\xd8"})
    assert shown(messages.compressed_image, jpeg)["data"] == base64.b64encode(b"\xff\xd8").decode()


@pytest.mark.parametrize(
    ("model", "theirs", "distortion"),
    [("pinhole", "plumb_bob", (0.1, 0.2, 0.3, 0.4, 0.5)), ("fisheye", "kannala_brandt", (0.1, 0.2, 0.3, 0.4))],
)
def test_a_lens_is_a_calibration(model, theirs, distortion):
    lens = samples.LENS.model_copy(update={"model": model, "distortion": distortion})
    found = shown(messages.camera_calibration, samples.setup(5.0, lens=lens))
    assert (found["width"], found["height"], found["distortion_model"]) == (640, 480, theirs)
    assert found["D"] == list(distortion)
    assert found["K"] == [400.0, 0.0, 319.5, 0.0, 400.0, 239.5, 0.0, 0.0, 1.0]
    assert found["P"] == [400.0, 0.0, 319.5, 0.0, 0.0, 400.0, 239.5, 0.0, 0.0, 0.0, 1.0, 0.0]
    assert messages.camera_calibration(ONE, samples.setup(5.0, lens=None)) is None


def test_tags_are_outlined_where_they_are_and_the_vehicle_is_seen_in_the_frame_of_the_target():
    found = shown(messages.tag_annotations, samples.tags(5.0, sequence=1))
    ((outline,), (number,)) = found["points"], found["texts"]
    assert outline["type"] == "LINE_LOOP"
    assert outline["points"][0] == {"x": 200.5, "y": 100.5}  # pixel centres are at integers here, at halves there
    assert len(outline["points"]) == 4
    assert (number["text"], number["position"]) == ("48", {"x": 200.5, "y": 100.5})
    found = shown(messages.seen_pose, samples.pose(5.0), MANY)
    assert found["frame_id"] == "pad"
    assert found["pose"]["position"] == {"x": 0.0, "y": 0.0, "z": 2.0}


@pytest.mark.parametrize(
    ("event", "level"),
    [(events.REFUSED, "ERROR"), (events.MODE, "INFO"), (events.FAILSAFE, "FATAL"), (events.WARNING, "WARNING")],
)
def test_events_and_refusals_are_lines_of_a_log(event, level):
    found, line = shown(messages.log_line, event), line_of(event)
    assert (found["level"], found["name"], found["message"]) == (level, "mk1", f"{line.text} {line.fix}".strip())
