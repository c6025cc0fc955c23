"""Every verb of the daemon as a method with its types.

Made by `python -m tools.docs` from telemetry/verbs.py; do not edit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import zenoh

from mkdaemon.client.asking import Asking, OnProgress
from mkdaemon.client.keytree import KeyTree

if TYPE_CHECKING:
    from mkdaemon.telemetry.command import Labels, Rates
    from mkdaemon.telemetry.control import Gains, ReleaseReport
    from mkdaemon.telemetry.mission import (
        MissionPoint,
        RouteStarted,
        WaypointList,
        WaypointsComparison,
        WaypointsStored,
    )
    from mkdaemon.telemetry.navi import NaviTarget
    from mkdaemon.telemetry.path import PathPiece, PathPoint, PathStored
    from mkdaemon.telemetry.preflight import PreflightReport
    from mkdaemon.telemetry.procedure import Cancelled
    from mkdaemon.telemetry.settings import (
        MixerTable,
        MotorControllers,
        OwedSets,
        SettingsBackup,
        SettingsComparison,
        SettingsRestoration,
        StoredSet,
    )


class PathsVerbs(Asking):
    """Verbs of `uav.paths`."""

    async def upload(self, points: Sequence[PathPoint] = (), pieces: Sequence[PathPiece] = ()) -> PathStored:
        """Store a path.

        It is checked, and can be flown by `setpoint/path` until the daemon restarts.

        Args:
            points: Flown through smoothly: at least two.
            pieces: In place of points: each begins where the one before ends, at the same velocity and acceleration.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self.ask("path_upload", "path:PathStored", {"points": points, "pieces": pieces}, 15)


class SettingsVerbs(Asking):
    """Verbs of `uav.settings`."""

    async def backup(
        self, slots: Sequence[int] = (1, 2, 3, 4, 5), *, on_progress: OnProgress | None = None
    ) -> SettingsBackup:
        """Read parameter sets.

        The active one is live again afterwards, proven.

        Args:
            slots: Which ones, besides the active one.
            on_progress: called with every step.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self.run("settings_backup", "settings:SettingsBackup", {"slots": slots}, on_progress)

    async def compare(self, sets: Sequence[StoredSet], *, on_progress: OnProgress | None = None) -> SettingsComparison:
        """Compare parameter sets with those of the FlightCtrl.

        Writes nothing.

        Args:
            sets: What to compare with.
            on_progress: called with every step.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self.run("settings_compare", "settings:SettingsComparison", {"sets": sets}, on_progress)

    async def restore(
        self,
        sets: Sequence[StoredSet],
        *,
        confirm: bool = False,
        dry_run: bool = False,
        on_progress: OnProgress | None = None,
    ) -> SettingsRestoration:
        """Write parameter sets that differ.

        The set that is active stays active.

        Args:
            sets: What to write.
            confirm: Must be true: the values change how the aircraft flies.
            dry_run: Read and compare only; needs no `confirm`.
            on_progress: called with every step.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self.run(
            "settings_restore",
            "settings:SettingsRestoration",
            {"confirm": confirm, "sets": sets, "dry_run": dry_run},
            on_progress,
        )

    async def write(
        self,
        values: Mapping[str, int | str | list[int] | list[str]],
        *,
        confirm: bool = False,
        slot: int | None = None,
        dry_run: bool = False,
        on_progress: OnProgress | None = None,
    ) -> SettingsRestoration:
        """Change parameters of one set by name.

        Args:
            values: New values by name; potis as `poti1`, bits as a list of names.
            confirm: Must be true: the values change how the aircraft flies.
            slot: Number of the set; None for the active one.
            dry_run: Read and compare only; needs no `confirm`.
            on_progress: called with every step.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self.run(
            "settings_write",
            "settings:SettingsRestoration",
            {"confirm": confirm, "slot": slot, "values": values, "dry_run": dry_run},
            on_progress,
        )

    async def recover(
        self,
        action: Literal["show", "retry", "discard"] = "show",
        *,
        confirm: bool = False,
        on_progress: OnProgress | None = None,
    ) -> OwedSets:
        """Look after a live set that was left unproven.

        Args:
            action: `retry`: try at once; `discard` (needs `confirm`): forget every note, because you know what is live.
            confirm: Must be true: the values change how the aircraft flies.
            on_progress: called with every step.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self.run(
            "settings_recover", "settings:OwedSets", {"confirm": confirm, "action": action}, on_progress
        )


class WaypointsVerbs(Asking):
    """Verbs of `uav.waypoints`."""

    async def upload(
        self,
        points: Sequence[MissionPoint],
        *,
        in_flight: bool = False,
        source: str = "",
        allow_unusual: bool = False,
        on_progress: OnProgress | None = None,
    ) -> WaypointsStored:
        """Replace the NaviCtrl's list by a mission, read it back and compare.

        Args:
            points: The points in the order they are flown.
            in_flight: Allow it with running motors, or while their state is unknown: it takes effect at once.
            source: Where they came from, for the event.
            allow_unusual: Take points that are more than 5 km away, below the start or more than 500 m above it.
            on_progress: called with every step.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self.run(
            "waypoints_upload",
            "mission:WaypointsStored",
            {"in_flight": in_flight, "points": points, "source": source, "allow_unusual": allow_unusual},
            on_progress,
        )

    async def read(self, *, on_progress: OnProgress | None = None) -> WaypointList:
        """Read the NaviCtrl's list.

        Args:
            on_progress: called with every step.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self.run("waypoints_read", "mission:WaypointList", {}, on_progress)

    async def verify(
        self, points: Sequence[MissionPoint], *, on_progress: OnProgress | None = None
    ) -> WaypointsComparison:
        """Compare the NaviCtrl's list with a mission.

        Writes nothing.

        Args:
            points: What to compare with.
            on_progress: called with every step.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self.run("waypoints_verify", "mission:WaypointsComparison", {"points": points}, on_progress)

    async def clear(self, *, in_flight: bool = False, on_progress: OnProgress | None = None) -> WaypointsStored:
        """Empty the NaviCtrl's list and see that it is empty.

        Args:
            in_flight: Allow it with running motors, or while their state is unknown: it takes effect at once.
            on_progress: called with every step.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self.run("waypoints_clear", "mission:WaypointsStored", {"in_flight": in_flight}, on_progress)


class RouteVerbs(Asking):
    """Verbs of `uav.route`."""

    async def start(self, *, confirm: bool = False, on_progress: OnProgress | None = None) -> RouteStarted:
        """Make the list ready to be flown by the pilot's GPS switch, in flight.

        Args:
            confirm: Must be true: the values change how the aircraft flies.
            on_progress: called with every step.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self.run("route_start", "mission:RouteStarted", {"confirm": confirm}, on_progress)

    async def end(self, *, confirm: bool = False, on_progress: OnProgress | None = None) -> WaypointsStored:
        """Empty the list, in flight too.

        With the GPS switch at coming home the aircraft flies home.

        Args:
            confirm: Must be true: the values change how the aircraft flies.
            on_progress: called with every step.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self.run("route_end", "mission:WaypointsStored", {"confirm": confirm}, on_progress)


class NaviVerbs(Asking):
    """Verbs of `uav.navi`."""

    async def target(
        self,
        position: tuple[float, float, float],
        *,
        confirm: bool = False,
        heading_deg: int | None = None,
        radius: int = 3,
        hold: int = 255,
        on_progress: OnProgress | None = None,
    ) -> NaviTarget:
        """Make a place the NaviCtrl's target.

        In flight; the pilot's GPS switch flies there.

        Args:
            position: East, north and up of home [m]. Up is flown only with height control; else the pilot's throttle
                holds it.
            confirm: Must be true: the values change how the aircraft flies.
            heading_deg: Compass heading to turn to [deg]; None keeps the heading.
            radius: The place counts as reached within this distance [m]; GPS is good for 2 to 3 m.
            hold: Time to stay there [s]; then a NaviCtrl 0.24 flies home.
            on_progress: called with every step.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self.run(
            "navi_goto",
            "navi:NaviTarget",
            {"confirm": confirm, "position": position, "heading_deg": heading_deg, "radius": radius, "hold": hold},
            on_progress,
        )


class MixerVerbs(Asking):
    """Verbs of `uav.mixer`."""

    async def read(self, *, on_progress: OnProgress | None = None) -> MixerTable:
        """Read the mixer of the FlightCtrl.

        Args:
            on_progress: called with every step.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self.run("mixer_read", "settings:MixerTable", {}, on_progress)

    async def write(
        self, name: str, motors: Sequence[int], *, confirm: bool = False, on_progress: OnProgress | None = None
    ) -> MixerTable:
        """Store a mixer, read it back and compare.

        The FlightCtrl uses it at once.

        Args:
            name: At most twelve ASCII characters.
            motors: 16 rows of throttle, pitch, roll, yaw; 64 is 100 %.
            confirm: Must be true: the values change how the aircraft flies.
            on_progress: called with every step.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self.run(
            "mixer_write", "settings:MixerTable", {"confirm": confirm, "name": name, "motors": motors}, on_progress
        )


class MotorControllersVerbs(Asking):
    """Verbs of `uav.motor_controllers`."""

    async def read(self, motors: Sequence[int], *, on_progress: OnProgress | None = None) -> MotorControllers:
        """Read the configuration of motor controllers.

        Args:
            motors: Which ones.
            on_progress: called with every step.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self.run("motor_controllers_read", "settings:MotorControllers", {"motors": motors}, on_progress)

    async def write(
        self,
        motor: int,
        *,
        confirm: bool = False,
        pwm_scaling: int | None = None,
        current_limit: int | None = None,
        temperature_limit: int | None = None,
        current_scaling: int | None = None,
        reverse: bool | None = None,
        save: bool = False,
        on_progress: OnProgress | None = None,
    ) -> MotorControllers:
        """Change some items of one motor controller, read them back and compare.

        Args:
            motor: Which one.
            confirm: Must be true: the values change how the aircraft flies.
            pwm_scaling: Limits the largest PWM; None keeps it, as for all items.
            current_limit: [A]
            temperature_limit: [degC]
            current_scaling: Gain of the current measurement.
            reverse: Sense of rotation.
            save: Keep it in the controller's EEPROM; otherwise it is gone without power.
            on_progress: called with every step.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self.run(
            "motor_controllers_write",
            "settings:MotorControllers",
            {
                "confirm": confirm,
                "motor": motor,
                "pwm_scaling": pwm_scaling,
                "current_limit": current_limit,
                "temperature_limit": temperature_limit,
                "current_scaling": current_scaling,
                "reverse": reverse,
                "save": save,
            },
            on_progress,
        )


class RecordsVerbs(Asking):
    """Verbs of `uav.records`."""

    async def mark(self, text: str) -> None:
        """Mark this moment in all recordings.

        Args:
            text: What happened.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        await self.order("mark", {"text": text}, 15, with_holder=True)


class VerbCalls(KeyTree):
    """Every verb as a method, of the vehicle or of a service."""

    def __init__(self, session: zenoh.Session, vehicle: str, endpoint: str) -> None:
        super().__init__(session, vehicle, endpoint)
        self._asking = Asking(self)
        self.paths = PathsVerbs(self)
        self.settings = SettingsVerbs(self)
        self.waypoints = WaypointsVerbs(self)
        self.route = RouteVerbs(self)
        self.navi = NaviVerbs(self)
        self.mixer = MixerVerbs(self)
        self.motor_controllers = MotorControllersVerbs(self)
        self.records = RecordsVerbs(self)

    async def release(self, reason: str = "asked for") -> ReleaseReport:
        """Release the aircraft now.

        Every client may, with or without a lease.

        Args:
            reason: Published with the event; a longer text is cut, never refused.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self._asking.ask("release", "control:ReleaseReport", {"reason": reason}, 15)

    async def gains(self) -> Gains:
        """Ask for model, gains and margins of the horizontal loop.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self._asking.ask("gains", "control:Gains", {}, 15)

    async def preflight(self) -> PreflightReport:
        """Make every check before a flight.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self._asking.ask("preflight", "preflight:PreflightReport", {}, 15)

    async def abort(self, reason: str = "asked for") -> None:
        """Stop the manoeuvre that is flown.

        Every client may; the holder keeps the lease.

        Args:
            reason: Published with the event; a longer text is cut, never refused.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        await self._asking.order("abort", {"reason": reason}, 15)

    async def accept_aircraft(self) -> None:
        """Confirm that the aircraft at a port that came back is the right one.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        await self._asking.order("accept_aircraft", {}, 15)

    async def rates(self, stream: str | None = None, interval: float | None = None) -> Rates:
        """Ask for a telemetry stream at a rate, or just for the present rates.

        Args:
            stream: Key of the message, for example `osd`, `attitude`, `debug`, `display`; None to look only.
            interval: Time between two frames [s]; 0 stops the stream; None to look only.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self._asking.ask("rates", "command:Rates", {"stream": stream, "interval": interval}, 15)

    async def labels(self, board: Literal["fc", "nc", "mag"]) -> Labels:
        """Ask for the names of a board's debug channels.

        Args:
            board: Whose.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self._asking.ask("labels", "command:Labels", {"board": board}, 60)

    async def cancel(self, id: str | None = None) -> Cancelled:
        """End the procedure that runs.

        The procedure leaves the board in its documented state.

        Args:
            id: Which one; None for whichever runs.

        Raises:
            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.
        """
        return await self._asking.ask("cancel", "procedure:Cancelled", {"id": id}, 60)
