"""The live screen of `mkctl teleop`: sticks, what is sent, lease, link, battery; plain letters, 80 columns."""

from __future__ import annotations

from typing import Final

from rich.text import Text

from mkdaemon.cli.mkctl.teleop.session import TeleopSession
from mkdaemon.cli.mkctl.teleop.watcher import Watcher
from mkdaemon.client.teleop.hands import PadHands
from mkdaemon.reading import Fact
from mkdaemon.telemetry.control import ControlOutput
from mkdaemon.telemetry.tone import Tone

COLUMNS: Final = 80
"""Width everything fits into."""
BAR: Final = 41
"""Characters of a stick's bar; odd, so that it has a middle."""
FULL: Final = 127.0
"""Stick at the end of its bar [stick]."""
OLD: Final = 1.5
"""A pad that was not known for longer is shown in red [s]."""
SHOWN: Final = ("control", "manoeuvre", "link", "stick_frames", "battery", "flight")
"""Facts of the aircraft, one line each."""
GOOD, BAD, DIM, PLAIN = "green", "bold red", "dim", ""
KEYBOARD_LEGEND: Final = (
    "arrows pitch roll  a d yaw  w s thrust  m hover  e enable button  SPACE release",
    "f fine  l lock  c recentre  r reset  8 2 4 6 trim  T take-off  H hold  L land",
    "X stop the motors  q quit",
)
_COLOURS: Final = {Tone.NOTE: PLAIN, Tone.OK: GOOD, Tone.WARN: BAD, Tone.BAD: BAD, Tone.UNKNOWN: PLAIN}


def bar(value: float | None, sent: float | None) -> str:
    """A stick as a line of letters: `|` its middle, `#` from there to what is asked for, `o` what is sent."""
    cells = ["-"] * BAR
    middle = BAR // 2
    if value is not None:
        end = _cell(value)
        for at in range(min(middle, end), max(middle, end) + 1):
            cells[at] = "#"
    cells[middle] = "|"
    if sent is not None:
        cells[_cell(sent)] = "o"
    return "".join(cells)


def _cell(value: float) -> int:
    middle = BAR // 2
    return min(max(middle + round(middle * value / FULL), 0), BAR - 1)


def screen_lines(session: TeleopSession, watcher: Watcher, title: str, *, has_keyboard: bool) -> list[Text]:
    """Everything that is shown, one line each.

    Args:
        session: devices, teleop, lease.
        watcher: what is known of the aircraft.
        title: vehicle and endpoint.
        has_keyboard: keys are explained.
    """
    teleop = session.teleop
    name = teleop.pilot or next(iter(teleop.hands), None)
    hands = None if name is None else teleop.hands.get(name)
    lines = [_line(("mkctl teleop  ", "bold"), (title, PLAIN))]
    lines += _pads(session)
    lines += _sticks(session, watcher, hands)
    picture = watcher.picture
    lines.append(_line(("aircraft ", DIM), (picture.headline, _COLOURS[picture.tone])))
    lines += [_fact(picture.fact(word)) for word in SHOWN]
    lines += [_now(session), _line(("last     ", DIM), (session.notice, PLAIN))]
    if has_keyboard:
        lines += [_line((text, DIM)) for text in KEYBOARD_LEGEND]
    return lines


def _now(session: TeleopSession) -> Text:
    """What is done and why; before the daemon flies, what it waits for."""
    output = session.output
    words = output.reason
    if output.setpoint is not None and not session.keeper.is_engaged:
        words = f"{words}; {session.keeper.flight.reason}"
    flies = session.keeper.is_engaged and output.setpoint is not None and not output.is_neutral
    return _line(("now      ", DIM), (words, GOOD if flies else BAD))


def _pads(session: TeleopSession) -> list[Text]:
    lines = []
    now = session.now
    for name, hands in session.teleop.hands.items():
        flies = name == session.teleop.pilot
        _, age = hands.inputs.oldest(hands.axes.all, now)
        words = "flies" if flies else "ready" if hands.has_seen_zero else "not ready"
        stuck = f"  stuck: {', '.join(hands.stuck)}" if hands.stuck else ""
        known = f"{age:5.2f} s" if age < 100 else "  -"
        lines.append(
            _line(
                ("pad      ", DIM),
                (f"{hands.facts.name[:40]:40}", "bold" if flies else PLAIN),
                (f" {words:9} ", PLAIN),
                (f"age {known}", _style(age)),
                (stuck, BAD),
            )
        )
    return lines or [_line(("pad      ", DIM), ("none", BAD))]


def _sticks(session: TeleopSession, watcher: Watcher, hands: PadHands | None) -> list[Text]:
    wanted = session.output.setpoint
    fields = dict(wanted.fields) if wanted is not None and wanted.kind == "stick" else {}
    if not fields and wanted is None and hands is not None:
        fields = hands.wish(is_engaged=True)._asdict()
    output = watcher.picture.fresh("control/output", ControlOutput) if session.keeper.is_engaged else None
    lines = []
    for axis, ends in (("pitch", "fwd"), ("roll", "right"), ("yaw", "left"), ("throttle", "up")):
        value, sent = fields.get(axis), None if output is None else getattr(output, axis)
        lines.append(
            _line(
                (f"{axis:9}", DIM),
                (bar(value, sent), PLAIN),
                (f" {_count(value)}", "bold"),
                (f"  sent {_count(sent)}", GOOD if sent is not None else DIM),
                (f"  + {ends}", DIM),
            )
        )
    if output is not None and output.limited:
        lines.append(_line(("         LIMITED: the daemon sends less than is asked for", "bold")))
    if hands is not None:
        thrust = hands.thrust
        held = "LOCKED" if thrust.is_locked else "held: move the stick to it" if thrust.is_waiting else ""
        lines.append(
            _line(
                (
                    f"         fine {'ON ' if hands.is_fine else 'off'}  trim pitch {hands.trim('pitch'):+.0f} roll "
                    f"{hands.trim('roll'):+.0f}  hover {thrust.hover:+.0f}  ",
                    PLAIN,
                ),
                (held, "bold"),
            )
        )
    return lines


def _fact(fact: Fact) -> Text:
    """What is known of one thing, and how old that is."""
    age = "    -" if fact.age is None else f"{min(fact.age, 999):5.1f} s"
    room = COLUMNS - 9 - 14
    return _line((f"{fact.name[:8]:9}", DIM), (f"{fact.aged[:room]:{room}}", _COLOURS[fact.tone]), (f" age {age}", DIM))


def _style(age: float) -> str:
    return GOOD if age < OLD else BAD


def _count(value: float | None) -> str:
    return "   -" if value is None else f"{value:+4.0f}"


def _line(*parts: tuple[str, str]) -> Text:
    text = Text(no_wrap=True, overflow="crop")
    for words, style in parts:
        text.append("".join(letter if letter.isprintable() else " " for letter in words), style=style)
    text.truncate(COLUMNS - 1)
    return text
