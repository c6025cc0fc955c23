"""The table of parameters, and what they mean."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from mkdaemon.client import Vehicle
from mkdaemon.config.gamepadfiles import load_mapping
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.gateways.boardset import GatewaySettings, backups_folder, numbers_of
from mkdaemon.gateways.ros2.commands import AXES, BUTTONS, frame_word, names_from, pad_facts
from mkdaemon.gateways.ros2.deck import Habits
from mkdaemon.gateways.ros2.messages import Frames
from mkdaemon.gateways.ros2.topics import words

ALL: Final = "all"
RATES: Final = "rates."
"""Prefix of the parameters that limit how often a topic is published."""
SETTINGS: Final = "settings."
"""Prefix of the parameters that are settings of the FlightCtrl."""


@dataclass(frozen=True, slots=True)
class NodeParameter:
    """One row.

    Attributes:
        name: of the parameter.
        default: its value unless given.
        about: what it does.
        is_fixed: it counts at the start alone.
    """

    name: str
    default: Any
    about: str
    is_fixed: bool = True


PARAMETERS: Final = (
    NodeParameter("topics", [ALL], "Names of the topics that are published, as in rates; all for every one."),
    NodeParameter("frame_prefix", "", "Before every frame, for several aircraft in one tree: mk1/."),
    NodeParameter("commands", True, "Whether joy, cmd_vel, setpoint_pose, path and the verbs that fly are there."),
    NodeParameter("cmd_vel.frame", "body", "Axes of cmd_vel: body, forward and left, or pad, those of the target."),
    NodeParameter("cmd_vel.stamped", False, "Whether cmd_vel is a TwistStamped, as Nav2 publishes it since Kilted."),
    NodeParameter("setpoint_pose.frame", "pad", "Frame of a setpoint_pose whose header names none: pad or body."),
    NodeParameter("path.speed", 0.5, "Speed along a path whose poses have no stamps that count up [m/s]."),
    NodeParameter("take_off.height", 1.5, "Height of the service take_off above the target [m]."),
    NodeParameter("hold.seconds", 60.0, "Time for which it holds its place without a new command before it lands [s]."),
    NodeParameter("joy.mapping", "xbox", "Mapping of the pad: a name of configs/gamepads, or a file."),
    NodeParameter("joy.axes", list(AXES), "The kernel's names of the axes of joy, in its order."),
    NodeParameter("joy.buttons", list(BUTTONS), "The kernel's names of the buttons of joy, in its order."),
    *(
        NodeParameter(f"{RATES}{word}", 0.0, f"Most messages of {word} a second [Hz]; 0 for all.", is_fixed=False)
        for word in words()
    ),
)
"""Every parameter; a further one is one row."""


@dataclass(frozen=True, slots=True)
class NodeSettings:
    """What the parameters say at the start.

    Attributes:
        topics: words of the topics that are published.
        frames: names of frames.
        commands: whether the gateway flies.
        velocity_frame: of `cmd_vel`.
        is_stamped: `cmd_vel` is a TwistStamped.
        pose_frame: of `setpoint_pose` without a frame.
        path_speed: along a `path` without times [m/s].
        axes: the kernel's names, in the order of `joy`.
        buttons: the same.
        habits: how it flies.
    """

    topics: frozenset[str]
    frames: Frames
    commands: bool
    velocity_frame: str
    is_stamped: bool
    pose_frame: str
    path_speed: float
    axes: tuple[str, ...]
    buttons: tuple[str, ...]
    habits: Habits


def settings_of(given: Mapping[str, Any]) -> NodeSettings:
    """Read parameters.

    Args:
        given: every one of the table.

    Raises:
        ConfigError: one of them cannot be; says which.
    """
    chosen = [] if ALL in given["topics"] else list(given["topics"])
    axes, buttons = tuple(given["joy.axes"]), tuple(given["joy.buttons"])
    height, seconds = float(given["take_off.height"]), float(given["hold.seconds"])
    if not 0.5 <= height <= 10.0:
        raise ConfigError(f"take_off.height is 0.5 to 10 m, not {height:g}")
    speed = float(given["path.speed"])
    if not 0.02 <= speed <= 5.0:
        raise ConfigError(f"path.speed is 0.02 to 5 m/s, not {speed:g}")
    if not 0.0 <= seconds < float("inf"):
        raise ConfigError(f"hold.seconds is a time [s], not {seconds:g}")
    return NodeSettings(
        topics=frozenset(names_from(chosen, dict.fromkeys(words()), "topics")),
        frames=Frames(str(given["frame_prefix"])),
        commands=bool(given["commands"]),
        velocity_frame=frame_word(given["cmd_vel.frame"], "cmd_vel.frame"),
        is_stamped=bool(given["cmd_vel.stamped"]),
        pose_frame=frame_word(given["setpoint_pose.frame"], "setpoint_pose.frame"),
        path_speed=speed,
        axes=axes,
        buttons=buttons,
        habits=Habits(load_mapping(given["joy.mapping"]), pad_facts(axes, buttons), seconds, height),
    )


class Pace:
    """Limits the rate of each topic, by the stamps of its values, so nothing waits.

    Attributes:
        rates: by the topic's word [Hz]; 0 for all.
    """

    def __init__(self, rates: Mapping[str, float]) -> None:
        self.rates = dict(rates)
        self._last: dict[str, float] = {}

    def lets_through(self, word: str, name: str, at: float) -> bool:
        """Whether a value is published.

        Args:
            word: of the topic.
            name: of the topic, with its camera.
            at: its stamp [s; monotonic].
        """
        rate = self.rates.get(word, 0.0)
        if not rate > 0.0:
            return True
        last = self._last.get(name)
        if last is not None and 0.0 <= at - last < 0.95 / rate:
            return False
        self._last[name] = at
        return True


Declare = Callable[[str, Any, str], None]
"""Declares a parameter, or gives it a value that was read: name, value, what it is."""


class BoardSettings:
    """The active set of the FlightCtrl as parameters of the gateway's node: `settings.gyro_p`.

    They are declared when they are read, and a new value is written as `mkctl settings write` writes it; MAVROS does
    the same with the parameters of its autopilot. Before the first write the set is saved.
    """

    def __init__(self, uav: Vehicle, declare: Declare) -> None:
        """Have read nothing yet.

        Args:
            uav: the vehicle.
            declare: makes parameters.
        """
        self._set, self._declare = GatewaySettings(uav, partial(backups_folder, "ros2")), declare

    async def pull(self) -> int:
        """Read the active set; how many parameters it has.

        Raises:
            MkError: it cannot be read, or its layout is not known.
        """
        await self._set.read()
        stored = self._set.stored
        if stored is None or stored.layout is None:
            raise MkError("the layout of these settings is not known: `mkctl settings show`")
        shown = 0
        for name, parameter, _ in numbers_of(stored.layout):
            if name != "revision":
                value = stored[name]
                about = f"{parameter.meaning}{f' [{parameter.unit}]' if parameter.unit else ''}"
                self._declare(f"{SETTINGS}{name}", list(value) if isinstance(value, tuple) else value, about)
                shown += 1
        return shown

    async def write(self, name: str, value: Any) -> None:
        """Write one setting of the set that was read.

        Args:
            name: of the parameter.
            value: what it is to be.

        Raises:
            MkError: the daemon refuses, or it is not proven.
        """
        if not self._set.slot:
            raise MkError("the settings have not been read: call param/pull")
        await self._set.write(name.removeprefix(SETTINGS), value if isinstance(value, int) else tuple(value))
