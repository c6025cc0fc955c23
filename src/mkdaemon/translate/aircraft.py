"""The aircraft as a plant, from the active parameter set of its FlightCtrl."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, cast

from mkdaemon.control.estimator.model import NO_FILTER, STICK_FILTER, AircraftModel, Gap, ModelUnknown
from mkdaemon.protocol.dialect import Dialect
from mkdaemon.protocol.generations import fc_generation
from mkdaemon.protocol.settings import ParameterSet, poti_number

_NAMES: Final = ("stick_p", "gyro_p", "gyro_i", "integral_factor", "gyro_stability", "stick_yaw_p")


_EASY: Final = {"stick_p": 6, "stick_yaw_p": 4}
"""What `AircraftModel` has by default: the set Easy."""


def assumed_model(dialect: Dialect) -> AircraftModel:
    """Return the model of an aircraft whose own is not known: the factory's active set on its own firmware.

    Args:
        dialect: how the FlightCtrl speaks, which tells its release, and whether it filters its sticks.
    """
    easy = AircraftModel(stick_filter=STICK_FILTER if dialect.stick_filter else NO_FILTER)
    generation = fc_generation(dialect.fc_release) if dialect.fc_release else None
    if generation is None:
        return _at_its_board(easy, dialect)
    tilt, yaw = generation.stick_p / _EASY["stick_p"], generation.stick_yaw_p / _EASY["stick_yaw_p"]
    model = replace(
        easy,
        rad_per_count=tilt * easy.rad_per_count,
        yaw_linear=yaw * easy.yaw_linear,
        yaw_square=yaw * easy.yaw_square,
    )
    return _at_its_board(model, dialect)


def aircraft_model(
    parameters: ParameterSet | None, dialect: Dialect, *, has_slow_leak: bool
) -> AircraftModel | ModelUnknown:
    """Return the model of this aircraft, or which parameter of its set prevents one.

    Args:
        parameters: the active set; None where it could not be read.
        dialect: how the FlightCtrl speaks, which tells whether it filters its sticks.
        has_slow_leak: a NaviCtrl newer than 0.24 is mounted.

    Source: docs/control.md, "The attitude loop".
    """
    layout = None if parameters is None else parameters.layout
    if parameters is None or layout is None:
        return ModelUnknown(Gap.UNREAD)
    numbers: dict[str, int] = {}
    for name in _NAMES:
        if name not in layout.places:
            return ModelUnknown(Gap.UNREAD, name)
        value = cast("int", parameters[name])  # all six are plain numbers in every layout
        poti = poti_number(value)  # of a gain that the firmware takes as it stands, too: no aircraft flies with 248
        if poti is not None:
            return ModelUnknown(Gap.ON_POTENTIOMETER, name, value, poti)
        numbers[name] = value
    found = AircraftModel.from_parameters(**numbers, has_stick_filter=dialect.stick_filter, has_slow_leak=has_slow_leak)
    return found if isinstance(found, ModelUnknown) else _at_its_board(found, dialect)


def _at_its_board(model: AircraftModel, dialect: Dialect) -> AircraftModel:
    """The aircraft as the board at the end of the line tells of it."""
    is_old = dialect.fc_release is not None and not dialect.stick_filter
    return model.by_packets() if is_old and dialect.via_navictrl else model
