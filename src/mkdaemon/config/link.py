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

    Another device is spoken to with link tests until the link counts as garbage or mute. `/dev/ttyUSB0` changes
    when adapters are replugged; a name below `/dev/serial/by-id` does not."""
    baud: Annotated[int, Field(ge=1200, le=921600)] = 57600
    """Line rate [baud]; MikroKopter boards speak 57600.

    At another rate only garbage arrives; with `probe_baud` the right one is found, some seconds later."""
    wait_for_port: bool = False
    """Wait when the port is missing at the start, instead of ending; a recording waits for its first subscriber.

    False ends the daemon where the adapter is not plugged in yet; true hides a name that is wrong."""
    rates: Literal["auto", "off"] | dict[str, Milliseconds] = "auto"
    """Interval of each stream by message key [ms], for example `{osd = 100, attitude = 50}`; `auto`: the best mix.

    Slower streams make the estimate older and the link look stale later; faster ones than the line carries are
    refused with the arithmetic."""
    echo_hz: Literal["auto"] | Annotated[float, Field(ge=0, le=50)] = 5.0
    """Rate of link tests [Hz]; 0 for none; `auto` sends one only where other traffic has not just proven the link.

    Lower finds a line that is lost in one direction later: with 0 a release comes only when the boards' own frames
    stop. Higher takes room from streams."""
    max_line_share: Annotated[float, Field(gt=0, le=1)] = 0.85
    """Largest share of the line that streams may be planned for, per direction.

    Higher leaves no room for requests and repeats: answers come late, and frames are lost. Lower refuses streams
    that would fit."""
    gap_ms: Annotated[float, Field(ge=2.25, le=100)] = 12.0
    """Idle line after each frame to a FlightCtrl, which has one receive buffer [ms].

    With a smaller one a FlightCtrl loses the next frame, in flight 9 of 100 after 5 ms and none after 12 ms; higher
    costs stick frames a second."""
    setpoint_hz: Annotated[float, Field(gt=0, le=100)] = 44.0
    """Most external control frames a second; 40 where a NaviCtrl 0.24 passes them on [Hz].

    A FlightCtrl looks at the sticks with every frame of its receiver: 44 times a second with PPM. Higher loses frames
    by radio and moves nothing sooner; lower makes steps in the flight."""
    renewal: Annotated[float, Field(ge=0.5, le=2.0)] = 1.5
    """Longest time between two renewals of the subscriptions [s]; boards drop them after 4.0 s.

    They are renewed as often as the measured losses ask for, so that they run out less than once in 100 hours; a line
    that loses nothing is renewed about every half second. Lower takes room on the line."""
    max_loss_percent: Annotated[float, Field(gt=0, le=100)] = 5.0
    """Loss over the moving window above which the link counts as degraded [%].

    Higher calls a bad radio good; lower calls a good one degraded, which is only a word."""
    window: Annotated[float, Field(ge=1, le=120)] = 10.0
    """Moving window of all statistics [s].

    Longer hides short losses; shorter makes the figures jump."""
    probe_baud: bool = True
    """Try other line rates while nothing but garbage arrives.

    False stays at `baud`, and an adapter at another rate yields garbage until `baud` is corrected."""
    probe_flightctrl: bool = True
    """With the motors known off, look through a NaviCtrl for the FlightCtrl's version; telemetry pauses 0.6 s, and the
    NaviCtrl's camera servos stop for that long: false where they must not.

    False leaves the FlightCtrl's release unknown behind a NaviCtrl, and an aircraft whose release is not known is
    read-only."""
    flightctrl_looks: Annotated[int, Field(ge=1, le=1000)] = 5
    """Looks for a FlightCtrl that does not answer, after 1, 4, 15 and 60 s; then none until the port is opened or a
    board boots.

    Fewer give up on a board that starts slowly; more interrupt the telemetry again and again."""
    reopen_min: Annotated[float, Field(gt=0, le=10)] = 0.05
    """First delay before a lost port is opened again [s].

    Higher makes a short loss of the adapter longer."""
    reopen_max: Annotated[float, Field(gt=0, le=60)] = 1.0
    """Longest delay between two attempts [s].

    Higher leaves the aircraft longer without a daemon after the adapter is back."""
    label_cache: Path | None = None
    """File in which analog labels are kept by board, version and checksum; unset keeps them in memory.

    Unset asks the board for 32 labels at every start, which takes seconds."""

    @model_validator(mode="after")
    def _delays_in_order(self) -> Self:
        if self.reopen_min > self.reopen_max:
            msg = f"reopen_min {self.reopen_min:g} <= reopen_max {self.reopen_max:g} does not hold"
            raise ValueError(msg)
        return self
