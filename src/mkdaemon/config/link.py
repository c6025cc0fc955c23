"""The serial line: which port, what to ask for, when to worry."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from mkdaemon.config.base import Section

Milliseconds = Annotated[float, Field(ge=10, le=2550)]
"""Interval of a stream; boards count it in steps of 10 ms up to 255."""


LONGEST_NAME: Final = 255
"""Of a file in its folder [bytes]; limits.h, NAME_MAX."""
LONGEST_PORT: Final = 4000
"""Longest address of a port; limits.h, PATH_MAX is 4096 bytes."""


def _check_port(url: str) -> str:
    """Return an address that the system can be asked for.

    Raises:
        ValueError: no device, file or host can be called so.
    """
    if not url.isprintable():
        raise ValueError("it has characters that no device has in its name; write it again by hand")
    if len(url) > LONGEST_PORT or any(len(part.encode()) > LONGEST_NAME for part in url.split("/")):
        raise ValueError(f"it is too long for the name of a device ({LONGEST_NAME} bytes)")
    try:
        url.removeprefix("tcp:").rpartition(":")[0].encode("idna" if url.startswith("tcp:") else "utf-8")
    except UnicodeError as error:
        raise ValueError("no host can be called so") from error
    return url


class LinkConfig(Section):
    """One line to a MikroKopter."""

    port: Annotated[str, AfterValidator(_check_port)] = ""
    """`/dev/serial/by-id/...`, `pty:/dev/pts/N`, `tcp:host:port` or `replay:FILE?speed=20`.

    Another device receives link tests until the link counts as garbage or mute. `/dev/ttyUSB0` can change when adapters
    are replugged; a name below `/dev/serial/by-id` does not."""
    baud: Annotated[int, Field(ge=1200, le=921600)] = 57600
    """Line rate [baud]; MikroKopter boards use 57600.

    At another rate only garbage arrives; `probe_baud` finds the right rate within some seconds."""
    wait_for_port: bool = False
    """If the port is missing at the start, wait instead of ending; a recording waits for its first subscriber.

    With false, the daemon ends if the adapter is not plugged in yet; with true, a wrong name goes unnoticed."""
    rates: Literal["auto", "off"] | dict[str, Milliseconds] = "auto"
    """Interval of each stream by message key [ms], for example `{osd = 100, attitude = 50}`; `auto`: the best mix.

    Slower streams delay the estimate and the detection of a lost link. Faster streams than the line carries are refused
    with the arithmetic."""
    echo_hz: Literal["auto"] | Annotated[float, Field(ge=0, le=50)] = 5.0
    """Rate of link tests [Hz]; 0 for none; `auto` sends one only if no other traffic has just proven the link.

    A lower rate detects the loss of one direction later; with 0, the daemon releases only after the boards' own frames
    stop. A higher rate takes room from streams."""
    max_line_share: Annotated[float, Field(gt=0, le=1)] = 0.85
    """Largest share of the line for streams, in each direction.

    Higher leaves no room for requests and repeats: answers are late, and frames are lost. Lower refuses streams that
    would fit."""
    gap_ms: Annotated[float, Field(ge=2.25, le=100)] = 12.0
    """Idle line after each frame to a FlightCtrl, which has one receive buffer [ms].

    With a smaller gap a FlightCtrl loses the next frame: in flight 9 of 100 after 5 ms, none after 12 ms. A larger gap
    allows fewer stick frames a second."""
    setpoint_hz: Annotated[float, Field(gt=0, le=100)] = 44.0
    """Largest rate of stick frames; 40 through a NaviCtrl 0.24 [Hz].

    A FlightCtrl uses the sticks once with every frame of its receiver, 44 times a second with PPM. A higher rate loses
    frames by radio without faster response; a lower rate makes the flight jerky."""
    renewal: Annotated[float, Field(ge=0.5, le=2.0)] = 1.5
    """Longest time between two renewals of the subscriptions [s]; boards drop them after 4.0 s.

    The daemon renews them as often as the measured losses require, so that they expire less than once in 100 hours;
    without losses about every half second. Lower takes room on the line."""
    max_loss_percent: Annotated[float, Field(gt=0, le=100)] = 5.0
    """Loss over the moving window above which the link counts as degraded [%].

    Higher hides a bad radio; lower calls a good one degraded, without further effect."""
    window: Annotated[float, Field(ge=1, le=120)] = 10.0
    """Moving window of all statistics [s].

    Longer hides short losses; shorter makes the figures noisy."""
    probe_baud: bool = True
    """Try other line rates while only garbage arrives.

    With false, an adapter at another rate delivers garbage until `baud` is corrected."""
    probe_flightctrl: bool = True
    """While the motors are off, redirect the line through a NaviCtrl to read the FlightCtrl's version. Telemetry and
    the NaviCtrl's camera servos stop for 0.6 s; set false if the servos must not stop.

    With false, the FlightCtrl's release behind a NaviCtrl stays unknown, and the aircraft is read-only."""
    flightctrl_looks: Annotated[int, Field(ge=1, le=1000)] = 5
    """Attempts to identify a FlightCtrl that does not answer, after 1, 4, 15 and 60 s; then none until the port
    is opened or a board boots.

    Fewer miss a board that starts slowly; more interrupt the telemetry repeatedly."""
    reopen_min: Annotated[float, Field(gt=0, le=10)] = 0.05
    """First delay before a lost port is reopened [s].

    Higher extends a short loss of the adapter."""
    reopen_max: Annotated[float, Field(gt=0, le=60)] = 1.0
    """Longest delay between two attempts [s].

    Higher leaves the aircraft longer without the daemon after the adapter returns."""
    label_cache: Path | None = None
    """File that stores analog labels by board, version and checksum; unset: only in memory.

    Without it the daemon reads 32 labels from the board at every start, which takes seconds."""

    @model_validator(mode="after")
    def _delays_in_order(self) -> Self:
        if self.reopen_min > self.reopen_max:
            msg = f"reopen_min {self.reopen_min:g} <= reopen_max {self.reopen_max:g} does not hold"
            raise ValueError(msg)
        return self
