"""The aircraft as a plant, from the active parameter set of its FlightCtrl."""

from __future__ import annotations

from typing import Final, cast

from mkdaemon.control.estimator.model import NO_FILTER, STICK_FILTER, AircraftModel
from mkdaemon.errors import ProtocolError
from mkdaemon.protocol.dialect import Dialect
from mkdaemon.protocol.settings import ParameterSet

_NAMES: Final = ("stick_p", "gyro_p", "gyro_i", "integral_factor", "gyro_stability", "stick_yaw_p")


def assumed_model(dialect: Dialect) -> AircraftModel:
    """Return the model of an aircraft whose parameter set cannot be read: the set Easy on its own firmware.

    Args:
        dialect: how the FlightCtrl speaks, which tells whether it filters its sticks.
    """
    return AircraftModel(stick_filter=STICK_FILTER if dialect.stick_filter else NO_FILTER)


def aircraft_model(parameters: ParameterSet, dialect: Dialect, *, has_slow_leak: bool) -> AircraftModel | None:
    """Return the model of this aircraft; None where its set does not say enough, or flies without angle feedback.

    Args:
        parameters: the active set.
        dialect: how the FlightCtrl speaks, which tells whether it filters its sticks.
        has_slow_leak: a NaviCtrl newer than 0.24 is mounted.

    Source: docs/control.md, "The attitude loop".
    """
    if parameters.layout is None:
        return None
    try:
        values = {name: parameters[name] for name in _NAMES}
    except (KeyError, ProtocolError):
        return None
    numbers = cast("dict[str, int]", values)  # all six are plain numbers in every layout
    try:
        return AircraftModel.from_parameters(
            **numbers, has_stick_filter=dialect.stick_filter, has_slow_leak=has_slow_leak
        )
    except ValueError:
        return None
