"""What to show of one vehicle, from the values it publishes: decided here, drawn by the page.

Nothing here waits, looks at a clock or knows a browser.
"""

from __future__ import annotations

import math
from collections import OrderedDict, deque
from dataclasses import asdict, dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from mkdaemon.client.place import HOME, AircraftPlace, place_of_estimate, place_of_gps, place_of_pose
from mkdaemon.reading import EventLine, Fact, Picture, Reading, fresh_for, line_of
from mkdaemon.reading.facts import age_words, dead_reckoning
from mkdaemon.telemetry.base import Stamped
from mkdaemon.telemetry.control import ControlError, ControlEstimate, ControlFence, ControlOutput
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.telemetry.link import LinkHealth
from mkdaemon.telemetry.path import PathFlown
from mkdaemon.telemetry.play import PlayState, PlayStatus
from mkdaemon.telemetry.state import Altitude, Attitude, Position
from mkdaemon.telemetry.vision import CameraSetup, Tags, VisionPose, VisionStats
from mkdaemon.view.page.daemontime import DaemonTime
from mkdaemon.view.page.optics import frustum, project, shape_of
from mkdaemon.view.page.overview import Overview
from mkdaemon.view.page.series import PageSeries

Array = npt.NDArray[np.float64]

TRAIL_STEP: Final = 0.1
"""Between two points of the trail [s]."""
PLOT_STEP: Final = 0.04
"""Between two points of a plot [s]."""
EVENTS: Final = 200
"""Lines of the log."""
SEEN: Final = 64
"""Images whose tags and poses are kept until the image itself comes, which takes longer."""
OLD: Final = 1.0
"""A last value that was older when it was asked for is not a part of a curve [s]."""
IMAGE_DEPTH: Final = 0.3
"""The image is drawn in the frustum at this share of the height above the target."""
SHALLOW: Final = 0.02
"""But not nearer than this [m]."""
LARGE: Final = ("height", "battery", "pose")
"""Facts whose numbers are seen first."""
_LEFT_OUT: Final = ("vehicle", "speed", "place", "port", "firmware")
"""Facts for which the page has no room: the scene shows the place, the alarms what is wrong with the vehicle."""
_SOURCES: Final = {"estimate": "estimate of the flight core", "pose": "pose of a camera", "gps": "by GPS"}


@dataclass(slots=True)
class CameraSeen:
    """What one camera saw last.

    Attributes:
        image: newest image that was published.
        tags: of the latest images, by number.
        poses: likewise; one for each target.
    """

    image: CameraFrame | None = None
    tags: OrderedDict[int, Tags] = field(default_factory=OrderedDict)
    poses: OrderedDict[int, dict[str, VisionPose]] = field(default_factory=OrderedDict)


class VehiclePicture:
    """One vehicle.

    Attributes:
        name: of the vehicle.
        is_played: it is a recording that is played.
        is_here: its daemon, or its player, is alive.
        series: what is drawn over time.
        events: lines of the log, and how many there were ever.
        flight: the whole recording at a glance; None while that is not known.
    """

    def __init__(self, name: str, *, is_played: bool = False) -> None:
        """Know nothing yet."""
        self.name = name
        self.is_played = is_played
        self.is_here = True
        self.series = {
            "trail": PageSeries(shortest_step=TRAIL_STEP),
            **{word: PageSeries(shortest_step=PLOT_STEP) for word in ("error", "height", "goal", "sticks")},
            **{word: PageSeries() for word in ("barometer", "latency")},
        }
        self.events: deque[EventLine] = deque(maxlen=EVENTS)
        self.event_count = 0
        self.flight: Overview | None = None
        self._time = DaemonTime()
        self._reading = Reading()
        self._looks: dict[str, CameraSeen] = {}
        self._play: PlayStatus | None = None
        self._boot: str | None = None
        self._restarts = 0

    # -- what comes -----------------------------------------------------------------------------------------------

    def take(self, suffix: str, value: object, now: float, age: float | None = None) -> None:
        """Take a value of the vehicle.

        Args:
            suffix: its key without the vehicle.
            value: as the client read it.
            now: our own time [s].
            age: that a last value had when it was asked for [s]; None for one that came by itself.
        """
        if not isinstance(value, Stamped):
            return
        stamp = value.stamp
        if self._boot not in (None, stamp.boot):
            self.restart()
        self._boot = stamp.boot
        self._time.take(stamp.monotonic + (age or 0.0), now)
        if isinstance(value, CameraFrame | Tags | VisionPose):
            self._look(suffix, value)
        if not isinstance(value, CameraFrame):
            self._reading.take(suffix, value, stamp.monotonic)
        line = line_of(value)
        if line is not None:
            self.events.append(line)
            self.event_count += 1
        if self.is_played or age is None or age < OLD:
            self._draw(value, stamp.monotonic)

    def take_play(self, status: PlayStatus, now: float) -> bool:
        """Take the status of the recording's player; return whether it jumped, so that everything is drawn again."""
        is_new = self._play is not None and status.starts != self._play.starts
        if is_new:
            self.restart()
        self._play = status
        moves = status.state is PlayState.PLAYING
        self._time.play_at(status.speed if moves else 0.0, now)
        if status.state in {PlayState.PAUSED, PlayState.ENDED}:  # what it says may be late, and time went on until then
            self._time.restart()
            self._time.take(status.zero + status.place, now)
        return is_new

    def restart(self) -> None:
        """Forget everything: another boot of the machine, or a recording that is played again."""
        self._time.restart()
        self._reading.forget()
        self._looks.clear()
        self._restarts += 1
        for series in self.series.values():
            series.clear()
        self.events.clear()

    def image(self, camera: str) -> CameraFrame | None:
        """The newest image of a camera."""
        look = self._looks.get(camera)
        return None if look is None else look.image

    def _look(self, suffix: str, value: CameraFrame | Tags | VisionPose) -> None:
        look = self._looks.setdefault(suffix.split("/")[1], CameraSeen())
        match value:
            case CameraFrame():
                look.image = value
            case Tags():
                look.tags[value.sequence] = value
            case VisionPose():
                look.poses.setdefault(value.sequence, {})[value.target] = value
        for seen in (look.tags, look.poses):
            while len(seen) > SEEN:
                seen.popitem(last=False)

    def _draw(self, value: Stamped, at: float) -> None:
        """Add to the curves."""
        series = self.series
        match value:
            case ControlEstimate():
                series["trail"].add(at, *value.position)
                series["height"].add(at, value.position[2])
            case VisionPose():
                flown = self._reading.at(at).last("control/estimate", ControlEstimate)
                if flown is None or at - flown.at > OLD:
                    series["trail"].add(at, *value.position_target)
                    series["height"].add(at, value.position_target[2])
            case ControlError():
                x, y, z = value.error_pad
                error = (100 * math.hypot(x, y), 100 * z)
                is_blind = dead_reckoning(self._reading.at(at)) is not None
                series["error"].add(at, *((None, None) if is_blind else error))
                series["goal"].add(at, value.goal[2])
            case ControlOutput():
                wanted = value.wanted or (None, None, None, None)
                sent = (value.pitch, value.roll, value.yaw, value.throttle)
                series["sticks"].add(at, *sent, *wanted, float(value.limited))
            case Altitude():
                series["barometer"].add(at, value.above_start)
            case LinkHealth():
                path = value.confirm if value.confirm.last_ms is not None else value.echo
                series["latency"].add(at, path.last_ms, path.p50_ms, path.p99_ms)

    # -- what is shown --------------------------------------------------------------------------------------------

    def show(self, now: float) -> dict[str, Any]:
        """Everything but curves and log, as the page takes it.

        Args:
            now: our own time [s].
        """
        absence = "" if self.is_here else "The recording is no longer played" if self.is_played else "No daemon is here"
        known = self._reading.at(self._time.now(now) or 0.0, absence)
        place = self._place(known)
        return {
            "vehicle": self.name,
            "restarts": self._restarts,
            "now": round(known.now, 3),
            "is_played": self.is_played,
            "is_here": self.is_here,
            "play": None if self._play is None else self._play.model_dump(mode="json"),
            "verdict": {"text": known.headline, "tone": known.tone},
            "alarms": [asdict(alarm) for alarm in known.alarms[1:]],
            "large": [_large(known.fact(word)) for word in LARGE],
            "lines": [fact.as_map() | {"text": fact.aged} for fact in known.facts if _is_line(fact)],
            "scene": self._scene(known, place),
            "cameras": [self._camera(known, name, place) for name in known.cameras()],
            "offers": self._offers(known),
        }

    def shapes(self) -> dict[str, Any]:
        """The tags of the target that is shown: what rarely changes."""
        known = self._reading.at(0.0)
        frame = (place := self._place(known)) and place.frame
        setups = (known.last(f"vision/{name}/setup", CameraSetup) for name in known.cameras())
        targets = [target for setup in setups if setup is not None for target in setup.value.targets]
        name = frame if frame not in (None, HOME) else next((target.name for target in targets), "")
        return {"target": name, "tags": shape_of(targets, name or "")}

    def _offers(self, known: Picture) -> dict[str, Any]:
        """Buttons: what each does, and why it cannot be pressed."""
        why_not = "A recording takes no commands." if self.is_played else ""
        return {offer.id: asdict(offer) | {"why_not": offer.why_not or why_not} for offer in known.offers}

    def _place(self, known: Picture) -> AircraftPlace | None:
        """Position of the aircraft: the flight core's estimate, else a camera's pose, else GPS; of any age."""
        found = []
        attitude = known.last("state/attitude", Attitude)
        estimate = known.last("control/estimate", ControlEstimate)
        if estimate is not None:
            found.append(place_of_estimate(estimate.value, None if attitude is None else attitude.value))
        for camera in known.cameras():
            pose = known.last(f"vision/{camera}/pose", VisionPose)
            if pose is not None:
                found.append(place_of_pose(pose.value))
        if not found:
            position = known.last("state/position", Position)
            if position is not None and attitude is not None:
                by_gps = place_of_gps(position.value, attitude.value)
                found += [] if by_gps is None else [by_gps]
        # A camera's pose is newer than the estimate of the same moment only by chance.
        return max(found, key=lambda place: place.at + OLD * (place.source == "estimate"), default=None)

    def _scene(self, known: Picture, place: AircraftPlace | None) -> dict[str, Any]:
        """The aircraft over its target. Where it is calculated without images it is drawn as one of the past."""
        fence = known.last("control/fence", ControlFence)
        error = known.fresh("control/error", ControlError)
        shown = {} if fence is None else fence.value.model_dump(include={"radius", "height", "floor"})
        scene: dict[str, Any] = {"aircraft": None, "goal": None, "fence": shown or None}
        scene["caption"] = "position of the aircraft: unknown"
        if place is not None:
            blind = dead_reckoning(known) if place.source == "estimate" else None
            age = max(0.0, known.now - place.at, blind or 0.0)
            is_stale = blind is not None or age > OLD
            where = "from home" if place.frame == HOME else f"over {place.frame}"
            old = f"; last image {age_words(age)} ago" if is_stale else ""
            scene["caption"] = f"{where}, {_SOURCES[place.source]}{old}"
            scene["aircraft"] = {
                "position": _rounded(place.position),
                "rotation": _rounded(place.rotation),
                "spread": None if place.spread is None else _rounded(place.spread),
                "frame": place.frame,
                "source": place.source,
                "age": round(age, 2),
                "is_stale": is_stale,
            }
        if error is not None:
            scene["goal"] = list(error.goal)
        if (path := known.fresh("control/path", PathFlown)) is not None:
            scene["path"] = [list(point) for point in path.points]
        return scene

    def _camera(self, known: Picture, name: str, place: AircraftPlace | None) -> dict[str, Any]:
        """One camera: frustum, newest image, and what was found in it."""
        look = self._looks.get(name, CameraSeen())
        setup = known.last(f"vision/{name}/setup", CameraSetup)
        stats = known.last(f"vision/{name}/stats", VisionStats)
        shown: dict[str, Any] = {"name": name, "frustum": None, "image": None, "outlines": [], "is_stale": False}
        if setup is not None and place is not None and place.frame != HOME:
            depth = max(SHALLOW, IMAGE_DEPTH * float(place.position[2]))  # above the ground, also where it stands
            shown["frustum"] = frustum(setup.value, place.position, place.rotation, depth)
        shown["caption"] = f"{name}: {known.fact(f'sight-{name}').aged}"
        shown["note"] = "no image: `jpeg_hz` of this camera is 0"
        image = look.image
        sequence = image.sequence if image is not None else next(reversed(look.poses or look.tags or {-1: None}))
        if image is not None:
            age = max(0.0, known.now - image.stamp.monotonic)
            is_stale = age > (fresh_for(f"vision/{name}/image") or 0.0)
            shown |= {"image": {"sequence": sequence}, "is_stale": is_stale}
            shown["note"] = f"image {age_words(age)} old" if is_stale else ""
        lens = None if setup is None else setup.value.lens
        width, height = (lens.width, lens.height) if lens else (0, 0)
        if not width and stats is not None:
            width, height = stats.value.width, stats.value.height
        shown["size"] = [width, height]
        shown["outlines"] = self._outlines(look, sequence, None if setup is None else setup.value)
        return shown

    def _outlines(self, look: CameraSeen, sequence: int, setup: CameraSetup | None) -> list[dict[str, Any]]:
        """Corners [px] of the tags in one image: as they were decoded, and where the pose puts the others."""
        tags = look.tags.get(sequence)
        found = [] if tags is None else [{"id": tag.id, "how": "decoded", "corners": tag.corners} for tag in tags.tags]
        if found or setup is None:
            return found
        return [
            {"id": None, "how": "tracked", "corners": corners}
            for pose in look.poses.get(sequence, {}).values()
            for corners in project(setup, pose)
        ]


def _is_line(fact: Fact) -> bool:
    """Whether a fact has a line: large numbers and captions of cameras have none beside them."""
    return fact.id not in (*LARGE[::2], *_LEFT_OUT) and not fact.id.startswith("sight-")


def _large(fact: Fact) -> dict[str, Any]:
    """A fact as a large number; of one that is not the present one its age, a dash where there is none."""
    number = "–"
    if fact.number is not None and fact.age is not None:
        present = f"{fact.number:.{2 if fact.unit == 'm' else 1}f} {fact.unit}"
        number = f"{age_words(fact.age)} old" if fact.is_stale else present
    return {"id": fact.id, "name": fact.name, "text": number, "tone": fact.tone}


def _rounded(numbers: Array) -> Any:
    return np.round(numbers, 4).tolist()


class PageReader:
    """One page that reads a picture: it is given what it does not have yet."""

    def __init__(self, picture: VehiclePicture) -> None:
        """Begin with everything.

        Args:
            picture: that is read.
        """
        self.picture = picture
        self._places = dict.fromkeys(picture.series, 0)
        self._events = 0
        self._shapes: dict[str, Any] | None = None
        self._flight: Overview | None = None
        self._restarts = -1

    def read(self, now: float) -> dict[str, Any]:
        """What to show at our own time [s]: everything said, and of curves, log and tags what is new."""
        picture = self.picture
        shown = picture.show(now)
        # An empty curve is cleared on the page too.
        shown["is_anew"] = shown["restarts"] != self._restarts
        self._restarts = shown["restarts"]
        shown["series"] = {}
        for word, series in picture.series.items():
            new = series.since(self._places[word])
            self._places[word] = series.count
            if new:
                shown["series"][word] = new
        new_events = min(picture.event_count - self._events, len(picture.events))
        self._events = picture.event_count
        shown["events"] = [line.as_map() for line in list(picture.events)[-new_events:]] if new_events > 0 else []
        shapes = picture.shapes()
        if shapes != self._shapes:
            self._shapes = shown["shapes"] = shapes
        if picture.flight is not self._flight and shown["play"] is not None:
            self._flight = picture.flight
            shown["flight"] = None if self._flight is None else self._flight.as_map(shown["play"]["zero"])
        return shown
