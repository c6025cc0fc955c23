"""Why a command is refused: every refusal of the whole program, with its reason and its fix.

A client can know them all: docs/keys.md shows this table, and a test walks it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.failures import FAILURES
from mkdaemon.telemetry.tokens import Refusal, Status, Token

__all__ = ["REFUSALS", "Refusal", "Status", "Token", "refuse"]

REFUSALS: Final[Mapping[str, Refusal]] = {
    # the request itself
    Token.MALFORMED: Refusal(
        Status.DENIED, "the request cannot be read: {detail}.", "Send a msgpack map; `mkctl send --help` shows fields."
    ),
    Token.BAD_FIELD: Refusal(
        Status.DENIED, "{name} does not take this: {detail}.", "`mkctl get schema/{name}.v1` shows fields and limits."
    ),
    Token.UNKNOWN_MESSAGE: Refusal(
        Status.UNSUPPORTED, "{board} has no request {name!r}.", "Did you mean {near}? docs/protocol.md lists all."
    ),
    Token.UNKNOWN_VERB: Refusal(
        Status.UNSUPPORTED, "there is no verb {name!r}.", "Did you mean {near}? See docs/keys.md."
    ),
    Token.UNSUPPORTED: Refusal(
        Status.UNSUPPORTED, "this firmware does not know {name}: {detail}.", "docs/protocol.md says who does."
    ),
    Token.READ_ONLY: Refusal(
        Status.DENIED, "the aircraft is read-only: {detail}.", "Connect a firmware this version knows; `mkctl status`."
    ),
    Token.DISCOVERING: Refusal(
        Status.BUSY,
        "the aircraft is not known yet: {detail}.",
        "The board is asked again every few seconds while telemetry says that the motors stand still; `mkctl status`.",
    ),
    Token.BUSY: Refusal(Status.BUSY, "{detail}.", "Try again when the first one has been answered."),
    Token.INTERNAL: Refusal(
        Status.DENIED, "the daemon failed on it: {detail}.", "This is a defect; see the daemon's log."
    ),
    # the line
    Token.LINK_DOWN: Refusal(
        Status.DENIED, "the link is {state}: {detail}.", "`mkctl health` shows the line; check cable, power, port."
    ),
    Token.TIMEOUT: Refusal(
        Status.TIMEOUT,
        "{board} did not answer {name}: {detail}.",
        "The boards never say no: check `mkctl health`, then whether docs/protocol.md lists a condition for {name}.",
    ),
    Token.LINE_BUDGET: Refusal(
        Status.DENIED,
        "{terms} of the line; {limit:.0f} % is the limit.",
        "Make the intervals {factor:.1f} times longer, or stop a stream.",
    ),
    Token.UPLINK_BUDGET: Refusal(
        Status.DENIED,
        "setpoints at {hz:.0f} Hz, echoes and renewals need {share:.0f} % of the line towards the board.",
        "Lower the setpoint or echo rate.",
    ),
    Token.NO_SUCH_STREAM: Refusal(Status.UNSUPPORTED, "{board} has no stream {name!r}.", "It has {known}."),
    Token.BOARD_UNREACHABLE: Refusal(
        Status.DENIED, "{board} cannot be reached from here: {detail}.", "Connect to it, or redirect the line first."
    ),
    Token.NO_REPLY: Refusal(Status.UNSUPPORTED, "{name} is never answered.", "Send it without waiting."),
    Token.RECORDING: Refusal(Status.DENIED, "a recording plays: nobody listens.", "Connect an aircraft."),
    Token.NOT_REDIRECTABLE: Refusal(
        Status.UNSUPPORTED, "the line cannot be passed through to {board}.", "Connect to that board directly."
    ),
    Token.MOTORS_NOT_KNOWN_OFF: Refusal(
        Status.DENIED,
        "a redirection stops the NaviCtrl's telemetry and servos.",
        "Stop the motors and wait for telemetry that says so.",
    ),
    Token.WRONG_LAYOUT: Refusal(
        Status.DENIED,
        "this FlightCtrl takes another external control than {given}.",
        "This is a defect of the program that built the frame; see the log.",
    ),
    Token.RELEASING: Refusal(Status.BUSY, "a release is under way.", "Wait for its result."),
    Token.UNCONFIRMED: Refusal(Status.BUSY, "the last release is not confirmed yet.", "Wait until it is, or 6 s."),
    Token.BOARD_DEAF: Refusal(
        Status.BUSY, "the line waits for {detail}.", "Wait up to 5 s; sticks begin from neutral then."
    ),
    Token.REMEMBERED_ONLY: Refusal(
        Status.DENIED,
        "a FlightCtrl behind a NaviCtrl cannot be asked in flight; before this start or opening of the port it was "
        "{firmware}, and flying time, charge and home say that it is the same flight.",
        "Repeat with `use_remembered` (`mkctl lease take --use-remembered`) if it is, or land and stop the motors.",
    ),
    Token.NOTHING_REMEMBERED: Refusal(
        Status.DENIED,
        "no flight is remembered that telemetry shows going on.",
        "Repeat without `use_remembered`; land and stop the motors, and the FlightCtrl is asked.",
    ),
    # danger gate
    Token.NOT_ENABLED: Refusal(
        Status.DENIED, "{name} is off: {detail}.", "Set commands.{option} = true in the configuration, knowing why."
    ),
    Token.NOT_CONFIRMED: Refusal(
        Status.DENIED, "{name} is dangerous: {detail}.", "Repeat the request with `confirm` set to {confirm!r}."
    ),
    Token.MOTORS_RUNNING: Refusal(Status.DENIED, "motors are running, and {detail}.", "Land, stop the motors, repeat."),
    Token.MOTORS_UNKNOWN: Refusal(
        Status.DENIED,
        "nobody has told lately whether motors run, and {detail}.",
        "Subscribe to the NaviCtrl's OSD data (`mkctl rate osd 200ms`), or check the cable to the NaviCtrl.",
    ),
    Token.BOARD_UNPROVEN: Refusal(
        Status.DENIED,
        "the last version reply does not prove that {board} is on the line ({detail}).",
        "`mkctl send version-request --board {board}` first; behind a NaviCtrl redirect the line.",
    ),
    Token.NEVER: Refusal(Status.DENIED, "{name} is never sent for a client: {detail}.", "{instead}"),
    Token.DEAF_TOO_LONG: Refusal(
        Status.DENIED,
        "the FlightCtrl would hear nothing for {seconds:.0f} s, and only power-off ends that.",
        "Make duration times count smaller: {limit:g} s in all, pauses as long as the beeps included.",
    ),
    # authority
    Token.NOT_LEASED: Refusal(Status.DENIED, "nobody holds the lease.", "`mkctl lease take` first."),
    Token.SLOW_PATH: Refusal(
        Status.DENIED,
        "the way to this client and back {took}, more than {limit:g} s: every limit of the ladder comes later by it.",
        "Fly from nearer, by cable or on the aircraft; or raise control.lease.max_path_delay (docs/safety.md).",
    ),
    Token.LEASE_HELD: Refusal(
        Status.DENIED,
        "{holder} holds the lease for another {left:.1f} s.",
        "Ask the holder, or take it with `--force`.",
    ),
    Token.WRONG_EPOCH: Refusal(
        Status.DENIED, "epoch {epoch} is not the lease's epoch {current}.", "Take a lease and use the epoch it returns."
    ),
    Token.NOT_HOLDER: Refusal(
        Status.DENIED,
        "only {holder} has the secret of the lease, and this was not made with it.",
        "Sign setpoints with the secret that `take` returned; docs/keys.md shows how.",
    ),
    Token.SEQUENCE_JUMP: Refusal(
        Status.DENIED,
        "sequence {sequence} is more than {limit} after {last}.",
        "Count sequence up by one from one setpoint to the next.",
    ),
    Token.STALE_SEQUENCE: Refusal(
        Status.DENIED, "sequence {sequence} is not after {last}.", "Count sequence up from one setpoint to the next."
    ),
    Token.NO_GUIDANCE: Refusal(
        Status.UNSUPPORTED, "nothing turns {name} into sticks: the daemon follows {known}.", "Stream one of these."
    ),
    Token.GATE_SHUT: Refusal(
        Status.DENIED,
        "the FlightCtrl ignores stick frames: ExternalControl of its active set is {value}, not above 128.",
        "Put it on a switch of the transmitter: `mkctl settings edit external_control=poti1` (to poti8).",
    ),
    Token.GATE_CONSTANT: Refusal(
        Status.DENIED,
        "no switch of the transmitter ends external control: ExternalControl of the active set is {value}, a constant.",
        "`mkctl settings edit external_control=poti1`, or set control.lease.allow_constant_gate = true, knowing why.",
    ),
    Token.GATE_SWITCHES_ALTITUDE: Refusal(
        Status.DENIED,
        "the switch that opens external control also turns height control on: HoeheChannel of the active set is "
        "{channel}, the gate's own channel, and height control is enabled (GlobalConfig bit 0).",
        "Put one of them on another channel: `mkctl settings edit external_control=poti2`, or altitude_channel=0.",
    ),
    Token.NO_CONTROL: Refusal(
        Status.DENIED, "external control is not possible: {detail}.", "`mkctl status` shows the firmware and the gate."
    ),
    Token.NO_ESTIMATE: Refusal(
        Status.DENIED,
        "{name} needs to know where the aircraft is, and no camera has seen a target yet.",
        "`mkctl watch 'vision/**'` shows what the cameras see; [[cameras]] in the configuration needs one, calibrated.",
    ),
    Token.NOT_READY: Refusal(
        Status.DENIED,
        "{name} cannot begin now: it waits for {detail}.",
        "Go on with what is flown and repeat; `mkctl watch control/estimate` shows the estimate.",
    ),
    Token.NO_FRAME: Refusal(
        Status.UNSUPPORTED,
        "{name} cannot be followed in frame {frame}: GPS errs by 2 to 3 m, and its age is not told.",
        "Give it in frame pad or body; `mkctl goto X Y Z --frame home` (`do/navi_goto`) lets the NaviCtrl fly there.",
    ),
    Token.FLYING_STOP: Refusal(
        Status.DENIED,
        "stopping the motors drops an aircraft that flies, and nobody says that it stands.",
        "Land first; `mkctl release` gives it to the pilot; --in-flight stops the motors in the air.",
    ),
    Token.NOTHING_FLOWN: Refusal(
        Status.DENIED, "there is no manoeuvre to stop: {phase}.", "`mkctl release` lets go of the aircraft at any time."
    ),
    Token.GUARD_DEAD: Refusal(
        Status.DENIED,
        "the guard process is gone: nothing would release the aircraft if the daemon died.",
        'Restart the daemon; docs/safety.md, "The guard".',
    ),
    # before a flight against a target
    Token.LOOP_UNSTABLE: Refusal(
        Status.DENIED,
        "with {cause} the control loop is not safe on the model of this aircraft: {detail}.",
        "`mkctl gains` shows the loop; {remedy}.",
    ),
    Token.GAIN_ON_POTI: Refusal(
        Status.DENIED,
        "{parameter} = {value} of the active set is potentiometer {poti} of the transmitter and no number: nobody can "
        "know what a stick does.",
        "Give it a number below 248: `mkctl settings edit {parameter}=...`, motors off; or fly by sticks.",
    ),
    Token.GAIN_ZERO: Refusal(
        Status.DENIED,
        "with {parameter} = {value} in the active set the aircraft does not answer its sticks as its model says.",
        "Give it a number above 0: `mkctl settings edit {parameter}=...`, motors off; or fly by sticks.",
    ),
    Token.LINK_POOR: Refusal(
        Status.DENIED,
        "{lost:.0f} % of the echoes are lost, more than {limit:g} %.",
        "`mkctl health` shows the line; move the antennas, or use a cable, before an autonomous flight.",
    ),
    Token.HEIGHT_CONTROL: Refusal(
        Status.DENIED,
        "height control takes the throttle for a climb rate: {detail}.",
        "Clear the bit altitude_control of global_config with `mkctl settings edit`; motors off.",
    ),
    Token.GPS_STEERS: Refusal(
        Status.DENIED,
        "the pilot's GPS switch is at {mode}: the NaviCtrl steers too, against the machine.",
        "The pilot turns the GPS switch to free.",
    ),
    Token.EMERGENCY_CLIMBS: Refusal(
        Status.DENIED,
        "with the emergency throttle NotGas {value} the aircraft does not sink when the receiver is lost; it hovers at "
        "about {hover}.",
        "Make it smaller: `mkctl settings edit emergency_throttle=...`; or set control.limiter.hover_throttle right.",
    ),
    Token.EMERGENCY_FALLS: Refusal(
        Status.DENIED,
        "with the emergency throttle NotGas {value} for {time} (NotGasZeit) the aircraft falls when the receiver is "
        "lost: {share:.0f} % of its weight are carried.",
        "`mkctl settings edit emergency_throttle=...`, {low} to {high}, and a time above zero.",
    ),
    Token.RECEIVER_WEAK: Refusal(
        Status.DENIED,
        "the pilot's receiver quality is {quality:.0f} %, below {limit:.0f} %.",
        "Switch the transmitter on, check antennas and range; the pilot must be able to take over.",
    ),
    Token.BATTERY_LOW: Refusal(Status.DENIED, "the battery is low: {voltage:.1f} V.", "Land, and change it."),
    Token.CAMERA_UNFIT: Refusal(
        Status.DENIED, "no camera can be flown by: {detail}.", "`mkctl watch 'vision/**'`; docs/cameras.md."
    ),
    Token.CAMERAS_CONTRADICT: Refusal(
        Status.DENIED,
        "cameras see the target in different places; against the others is {cameras}.",
        "Compare `vision/*/pose`; correct `mount` of the wrong one (`mkdaemon calibrate mount`), or remove it.",
    ),
    Token.IMAGES_LATE: Refusal(
        Status.DENIED,
        "half of the images of camera {camera} are more than {late:.0f} ms old when they have been looked at, and the "
        "limit is {limit:.0f} ms.",
        "End what else runs on this computer; a nearer camera, smaller images or fewer a second (docs/cameras.md).",
    ),
    Token.CAMERA_TURNED: Refusal(
        Status.DENIED,
        "the camera sees the opposite of what the boards report when the aircraft tilts (correlation {likeness:.1f}).",
        "Correct `mount` in the camera file (docs/frames.md), or the signs of the boards.",
    ),
    Token.STAMPS_OFF: Refusal(
        Status.DENIED,
        "the images' time stamps are {lag:+.0f} ms off, more than {limit:.0f} ms: the camera shows a tilt at another "
        "time than the boards.",
        "Set `latency_ms` of the camera to that, if it is constant; else use a source that stamps (docs/cameras.md).",
    ),
    Token.DISK_FULL: Refusal(
        Status.DENIED,
        "{free:.0f} MB are free where flights are recorded, less than {limit:.0f} MB.",
        "Make room; `mkctl preflight` looks again.",
    ),
    # faults of the simulator
    Token.UNKNOWN_FAULT: Refusal(Status.DENIED, "there is no fault {name!r}.", "Did you mean {near!r}? All: {known}."),
    Token.UNKNOWN_PARAMETER: Refusal(
        Status.DENIED, "fault {name!r} has no parameter {parameter!r}.", "Its parameters: {known}."
    ),
    Token.OUT_OF_RANGE: Refusal(Status.DENIED, "{name} cannot be {value}.", "Give {wanted}."),
    Token.NOT_SIMULATED: Refusal(
        Status.DENIED,
        "a recorded flight is only flown by a simulator: {detail}.",
        "Start `mkdaemon sim`, then `mkdaemon run --port` with the port that it prints, for the same vehicle.",
    ),
    **FAILURES,
}
"""Every refusal by its token; docs/keys.md shows the same table."""


class _Missing(str):
    """Stands for a word that was not given, whatever the format it should have had."""

    __slots__ = ()

    def __format__(self, spec: str) -> str:
        return f"({self!s})"


class _Words(dict[str, Any]):
    def __missing__(self, key: str) -> str:
        return _Missing(key)


def refuse(token: Token, **words: Any) -> CommandRejectedError:
    """Make the refusal `token`, its reason and fix filled in with `words`."""
    refusal = REFUSALS[token]
    filled = _Words(words)
    return CommandRejectedError(token, refusal.reason.format_map(filled), refusal.fix.format_map(filled))
