"""The room: two pads 6 m apart and 24 tags between them, as it is and as a survey left it."""

from __future__ import annotations

import numpy as np

from mksim.scene.room import AWAY, FIRST_ID, GOAL, PLACE_SD, START, TURN_SD, room_map


def test_two_pads_and_24_tags_between_them():
    [room] = room_map().targets
    assert room.is_map
    assert sum(tag.tag_id >= FIRST_ID for tag in room.tags) == 24
    places = {place.name: place.position.tolist() for place in room.places}
    assert places == {START: [-AWAY, 0.0, 0.0], GOAL: [0.0, 0.0, 0.0]}
    assert not any(tag.place_sd.any() or tag.turn_sd.any() for tag in room.tags)


def test_a_survey_is_off_by_what_it_says_and_a_print_moves_as_a_whole():
    [room], errors = room_map().targets, []
    true = {tag.tag_id: tag.position for tag in room.tags}
    for seed in range(1, 9):
        [known] = room_map(survey=seed).targets
        off = {tag.tag_id: tag.position - true[tag.tag_id] for tag in known.tags}
        errors += off.values()
        assert {(*tag.place_sd, *np.degrees(tag.turn_sd).round(9)) for tag in known.tags} == {
            (PLACE_SD,) * 3 + (TURN_SD,) * 3
        }
        assert off[48].tolist() == off[1].tolist()
    assert 0.8 < np.std(errors) / PLACE_SD < 1.2
    again, more = (room_map(survey=3).targets[0].tags[5].position.tolist() for _ in range(2))
    assert again == more
