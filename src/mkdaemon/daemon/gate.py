"""Which requests are dangerous, and what a client must show before one is sent.

One table, a line for every message that declares a danger (a test walks both); source: docs/protocol.md, "Danger", and
docs/safety.md, "The last function before the wire".
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

from mkdaemon.config.commands import CommandsConfig
from mkdaemon.daemon.vitals import Vitals
from mkdaemon.protocol.wire import Board, WireMessage
from mkdaemon.telemetry.command import refuse

ALL_KEYS_UP: Final = 0xFF
"""`DisplayRequest.keys_inverted` with no key pressed; WIRE 5."""
LIVE_SET: Final = 0xFF
"""`SettingsRequest.index` of the active set, the only one whose reading changes nothing; WIRE 7."""


@dataclass(frozen=True, slots=True)
class Rule:
    """What a dangerous request must meet.

    Attributes:
        confirm: the field `confirm` must be true.
        stopped: motors must be known to stand still.
        confirm_in_flight: `confirm` only while motors run or nobody knows.
        proven: the last version reply must have come from the board asked.
        option: switch of the `commands` section that must be on.
        never: why no client's request is ever sent.
        instead: what to do instead.
        applies: whether these fields make it dangerous.
    """

    confirm: bool = False
    stopped: bool = False
    confirm_in_flight: bool = False
    proven: bool = False
    option: str | None = None
    never: str | None = None
    instead: str = ""
    applies: Callable[[Mapping[str, Any]], bool] = lambda fields: True


_WRITES = Rule(confirm=True, stopped=True, proven=True)
_FLIES = "stick frames go through the lease and the limiter"
_FORK = Rule(confirm=True, proven=True, option="allow_fork_arming")

RULES: Final[Mapping[tuple[Board, str], Rule]] = MappingProxyType(
    {
        (Board.FC, "extern_control"): Rule(never=_FLIES, instead="Take a lease and stream `setpoint/stick`."),
        (Board.NC, "extern_control"): Rule(never=_FLIES, instead="Take a lease and stream `setpoint/stick`."),
        (Board.BL, "redundancy_setpoints"): Rule(
            never="it drives motors past the FlightCtrl", instead="Use `motor_test`, propellers off."
        ),
        (Board.FC, "reset"): Rule(confirm=True, stopped=True, proven=True, option="allow_reset"),
        (Board.NC, "reset"): Rule(confirm=True, stopped=True, proven=True, option="allow_reset"),
        (Board.FC, "receiver_bridge"): Rule(confirm=True, stopped=True, proven=True, option="allow_receiver_bridge"),
        (Board.FC, "settings_reset"): Rule(confirm=True, stopped=True, proven=True, option="allow_factory_reset"),
        (Board.MAG, "compass_feed"): Rule(confirm=True, stopped=True, proven=True, option="allow_compass_calibration"),
        (Board.FC, "arm_motors"): Rule(confirm=True, stopped=True, proven=True, option="allow_fork_arming"),
        # Stopping motors is asked for while they run; a running motor must not stand in its way.
        (Board.FC, "disarm_motors"): _FORK,
        (Board.FC, "recalibrate"): Rule(confirm=True, stopped=True, proven=True, option="allow_fork_arming"),
        (Board.FC, "beep"): Rule(confirm=True, stopped=True, proven=True, option="allow_fork_arming"),
        # All zero stops a test: it must never be refused.
        (Board.FC, "motor_test"): Rule(
            confirm=True, stopped=True, proven=True, applies=lambda fields: any(fields.get("motors", (1,)))
        ),
        (Board.FC, "write_settings"): _WRITES,
        (Board.FC, "select_settings"): _WRITES,
        (Board.FC, "write_mixer"): _WRITES,
        (Board.FC, "write_motor_controller"): _WRITES,
        (Board.FC, "motor_controller_request"): Rule(stopped=True, proven=True),
        # Reading a set that is not active loads it; while motors run the answer is another set than the one asked for.
        (Board.FC, "settings_request"): Rule(
            confirm=True, stopped=True, proven=True, applies=lambda fields: fields.get("index") != LIVE_SET
        ),
        (Board.FC, "compass_heading"): _WRITES,
        (Board.FC, "serial_channels"): Rule(confirm=True),
        (Board.NC, "serial_channels"): Rule(confirm=True),
        (Board.FC, "display_request"): Rule(
            confirm_in_flight=True, applies=lambda fields: fields.get("keys_inverted") != ALL_KEYS_UP
        ),
        (Board.NC, "display_request"): Rule(
            confirm_in_flight=True, applies=lambda fields: fields.get("keys_inverted") != ALL_KEYS_UP
        ),
        (Board.NC, "redirect"): Rule(confirm=True, stopped=True, proven=True),
        (Board.NC, "send_target"): Rule(confirm=True, proven=True),
        (Board.NC, "write_waypoint"): Rule(confirm_in_flight=True, proven=True),
        (Board.NC, "write_navi_parameter"): Rule(confirm_in_flight=True, proven=True),
        (Board.NC, "time_request"): Rule(proven=True),
    }
)
"""Every dangerous request by board and key."""


def rule_for(board: Board, message: WireMessage) -> Rule | None:
    """The rule a request falls under; None where it is harmless as it stands."""
    rule = RULES.get((board, message.spec.key))
    return rule if rule is not None and rule.applies(message.__dict__) else None


def check(
    board: Board, message: WireMessage, rule: Rule, *, confirmed: bool, cfg: CommandsConfig, vitals: Vitals, now: float
) -> None:
    """Let a dangerous request pass or refuse it; whether the board is proven is asked last and elsewhere.

    Args:
        board: who is asked.
        message: the request.
        rule: what it must meet.
        confirmed: the request carries `confirm = true`.
        cfg: what is enabled.
        vitals: what is known about the motors.
        now: [s; monotonic].

    Raises:
        CommandRejectedError: `never`, `not_enabled`, `motors_running`, `motors_unknown`, `not_confirmed`.
    """
    spec = message.spec
    name = f"{board.word}/{spec.key}"
    if rule.never is not None:
        raise refuse("never", name=name, detail=rule.never, instead=rule.instead)
    if rule.option is not None and not getattr(cfg, rule.option):
        raise refuse("not_enabled", name=name, detail=spec.danger, option=rule.option)
    running = vitals.motors_running(now)
    if running and spec.key == "motor_test" and vitals.is_testing_motors(now):
        running = False  # they turn because of the frame before this one
    if rule.stopped and running:
        raise refuse("motors_running", name=name, detail=f"must not meet them: {spec.danger or 'the board refuses it'}")
    if rule.stopped and running is None:
        raise refuse("motors_unknown", name=name, detail="no message has told so for 2 s")
    if not confirmed and (rule.confirm or (rule.confirm_in_flight and running is not False)):
        raise refuse("not_confirmed", name=name, detail=spec.danger, confirm=True)
