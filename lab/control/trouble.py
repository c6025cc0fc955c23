"""What is wrong in a flight with faults."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class Trouble:
    """What is wrong at the moment; times are ends [s].

    Attributes:
        client_silent: the client streams nothing.
        client_late: largest delay of a setpoint [s].
        client_wild: the client streams nonsense.
        blind: images show no target.
        camera_late: poses come later by this [s].
        camera_wrong: poses are off by this [m].
        eyes_stalled: no pose comes before this time; then all of them do.
        core_stalled: the core does not run, from a beginning to an end.
        telemetry_silent: no attitude is heard.
        uplink_dead: no stick frame arrives.
        gate_shut: the FlightCtrl takes no stick frame.
        lids: the pilot's throttle lies so far below hover [stick], each from a beginning to an end.
    """

    client_silent: float = 0.0
    client_late: tuple[float, float] = (0.0, 0.0)
    client_wild: float = 0.0
    blind: float = 0.0
    camera_late: tuple[float, float] = (0.0, 0.0)
    camera_wrong: tuple[float, float] = (0.0, 0.0)
    eyes_stalled: float = 0.0
    core_stalled: tuple[float, float] = (0.0, 0.0)
    telemetry_silent: float = 0.0
    uplink_dead: float = 0.0
    gate_shut: float = 0.0
    lids: list[tuple[float, float, float]] = field(default_factory=list)
