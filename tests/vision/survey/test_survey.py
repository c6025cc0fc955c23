"""Surveys by corners that a camera would see: places, what they are worth, and the tags that are named."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from lab.survey import laid_over
from mkdaemon.errors import VisionError
from mkdaemon.frames import rotation_from_euler
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.survey.bundle import CORNERS
from mkdaemon.vision.survey.picture import picture_of
from mkdaemon.vision.survey.survey import KnownTags, TagFault, survey
from mkdaemon.vision.tags.cellread import Detection
from mksim.scene.camera import BUILT_IN

LENS = BUILT_IN.intrinsics
PROJECTION = Projection(LENS)
SIDE = 0.16
NOISE = 0.1
"""Of a corner [px]."""
DOWN = np.diag([1.0, -1.0, -1.0])
IMAGES = 48


def room():
    """Places, turns and sides of twelve tags about 0.8 m apart, by code; one stands on a step and leans."""
    rng = np.random.default_rng(5)
    found = {}
    for code in range(12):
        place = np.array([0.8 * (code % 4), 0.8 * (code // 4), 0.0]) + np.append(rng.normal(0.0, 0.04, 2), 0.0)
        lean = 0.3 if code == 6 else 0.0
        found[code] = (place + np.array([0.0, 0.0, lean]), rotation_from_euler(lean, 0.0, rng.uniform(-3.0, 3.0)), SIDE)
    return found


def seen_from(centre, turn, tags, rng):
    """Tags that a camera sees whole."""
    found = []
    for code, (place, own, side) in tags:
        pixels, visible = PROJECTION.project(((CORNERS * side) @ own.T + place - centre) @ turn)
        if visible.all() and (pixels > 4.0).all() and (pixels < (LENS.width - 5.0, LENS.height - 5.0)).all():
            found.append(Detection("tag36h11", code, 0, 50.0, pixels + rng.normal(0.0, NOISE, (4, 2))))
    return found


def images(later=None, extra=(), count=IMAGES, seed=1):
    """What a camera sees that is carried over the room twice; from its middle on the room is another one."""
    rng, before = np.random.default_rng(seed), room()
    found = []
    for k in range(count):
        t = 2.0 * np.pi * k / count
        centre = np.array([1.2 + 1.2 * np.cos(2 * t), 0.8 + 0.8 * np.sin(6 * t), 1.8 + 0.2 * np.sin(3 * t)])
        turn = rotation_from_euler(*rng.normal(0.0, 0.1, 2), 3.0 * t) @ DOWN
        tags = before if later is None or k < 0.55 * count else later
        found.append(seen_from(centre, turn, [*tags.items(), *extra], rng))
    return found


@cache
def whole():
    return survey(images(), KnownTags(SIDE, {}, origin=5), PROJECTION)


def errors_of(found, truth):
    """Errors of the map `(n, 3)` in its axes, laid over the true places by the best motion."""
    places = np.array([one.tag.position for one in found.tags])
    true = np.array([truth[one.tag.tag_id][0] for one in found.tags])
    return laid_over(places, true)


def test_each_tag_is_found_within_a_millimetre_and_knows_it():
    found = whole()
    assert {one.tag.tag_id for one in found.tags} == set(room())
    off = errors_of(found, room())
    assert np.abs(off).max() < 0.002
    sds = np.array([one.place_sd for one in found.tags])
    assert 0.2 < float((off**2 / sds**2).mean()) < 2.0
    assert (found.left_out, found.weak) == ((), ())
    assert found.corner_sd == pytest.approx(NOISE, rel=0.2)
    assert found.images == IMAGES


def test_the_map_is_level_and_its_origin_is_the_tag_that_is_asked_for():
    found = whole()
    first = found.tags[0].tag
    assert (first.tag_id, first.position.tolist()) == (5, [0.0, 0.0, 0.0])
    flat = [one.tag.position[2] for one in found.tags if one.tag.tag_id != 6]
    assert np.ptp(flat) < 0.002
    step = next(one.tag for one in found.tags if one.tag.tag_id == 6)
    assert step.position[2] == pytest.approx(0.3, abs=0.002)
    assert np.degrees(np.arccos(step.rotation[2, 2])) == pytest.approx(np.degrees(0.3), abs=0.3)
    assert abs(first.rotation[1, 0]) < 1e-3, "the x axis is the origin's"


def test_a_measured_distance_gives_the_scale():
    places = {code: place for code, (place, _, _) in room().items()}
    true = float(np.linalg.norm(places[0] - places[11]))
    found = survey(images(), KnownTags(SIDE, {}, distances={(0, 11): 1.03 * true}), PROJECTION)
    assert found.scale == pytest.approx(1.03, abs=0.001)
    assert found.tags[0].tag.size == pytest.approx(1.03 * SIDE, rel=0.001)
    mapped = {one.tag.tag_id: one.tag.position for one in found.tags}
    assert np.linalg.norm(mapped[0] - mapped[11]) == pytest.approx(1.03 * true, rel=1e-6)


def changed(code, *, by=(0.0, 0.0, 0.0), side=SIDE):
    """The room with one tag shifted [m], or of another side [m]."""
    tags = room()
    place, turn, _ = tags[code]
    tags[code] = (place + by, turn, side)
    return tags


def only(code, shown):
    """The images with those sightings of one tag that are chosen by their number."""
    return [[one for one in image if one.tag_id != code or shown(k)] for k, image in enumerate(images())]


def alone(code):
    """The images with one tag only where nothing else is seen."""
    return [
        image if k % 2 else [one for one in image if one.tag_id == code]
        for k, image in enumerate(only(code, lambda k: k % 2 == 0))
    ]


FIRST, SECOND = room()[0], room()[11]
COPY = (0, (SECOND[0] + (0.35, -0.4, 0.0), FIRST[1], SIDE))
"""Another tag with the code 0, at the other end of the room."""
FAULTS = {
    TagFault.MOVED: (5, lambda: images(later=changed(5, by=(0.05, 0.02, 0.0)))),
    TagFault.TWICE: (0, lambda: images(extra=[COPY])),
    TagFault.WRONG_SIDE: (7, lambda: images(later=changed(7, side=0.17), count=80)[44:] * 2),
    TagFault.UNTIED: (2, lambda: alone(2)),
    TagFault.RARE: (3, lambda: only(3, lambda k: k in {3, 21})),
}


@cache
def surveyed(fault):
    return survey(FAULTS[fault][1](), KnownTags(SIDE, {}), PROJECTION)


@pytest.mark.parametrize("fault", TagFault)
def test_a_tag_that_does_not_fit_is_named_and_left_out(fault):
    code, found = FAULTS[fault][0], surveyed(fault)
    assert [(one.tag_id, one.fault) for one in found.left_out] == [(code, fault)]
    assert found.left_out[0].words
    assert code not in {one.tag.tag_id for one in found.tags}
    assert np.abs(errors_of(found, room())).max() < 0.003, "the others are where they were"


@pytest.mark.parametrize(
    ("make", "wanted", "words"),
    [
        (list, KnownTags(SIDE, {}), "no image shows a tag"),
        (lambda: images()[:3], KnownTags(SIDE, {}), "no tag is seen in 5 images"),
        (images, KnownTags(SIDE, {}, origin=99), "tag 99 cannot be the origin: no image shows it"),
        (FAULTS[TagFault.MOVED][1], KnownTags(SIDE, {}, origin=5), "tag 5 cannot be the origin: it was moved"),
        (images, KnownTags(SIDE, {}, distances={(0, 99): 2.0}), "tag 99 is not in the map"),
        (lambda: [image[:1] for image in images()], KnownTags(SIDE, {}), "together with another tag"),
    ],
)
def test_what_makes_no_map_is_refused_with_its_reason(make, wanted, words):
    with pytest.raises(VisionError, match=words):
        survey(make(), wanted, PROJECTION)


def test_a_tag_with_one_neighbour_is_weak_and_says_where_to_look():
    shown = []
    for image in images():
        codes = {one.tag_id for one in image}
        kept = {2, 3} if {2, 3} <= codes else codes - {3}
        shown.append([one for one in image if one.tag_id in kept])
    weak = dict(survey(shown, KnownTags(SIDE, {}), PROJECTION).weak)
    assert "look at it once more together with" in weak[3]


def test_the_picture_names_every_tag_and_what_was_left_out():
    found = surveyed(TagFault.MOVED)
    picture = picture_of(found)
    assert all(f">{one.tag.tag_id}</text>" in picture for one in found.tags)
    assert "left out: tag 5, it was moved" in picture
