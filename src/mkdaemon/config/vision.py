"""Configuration of targets and tracker.

A target file is TOML with one or more `[[targets]]`; each has `[[targets.tags]]` or a `[targets.board]`. Lengths are
metres, angles of a target file are degrees and say so in their names.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from mkdaemon.config.base import Section

Metres3 = tuple[float, float, float]
TagSize = Annotated[float, Field(ge=0.005, le=5.0, strict=True)]


class TagPlacement(Section):
    """One printed tag and where it sits in its target."""

    family: str = "tag36h11"
    """AprilTag family: tag36h11, tag25h9, tag16h5, tagStandard41h12, tagStandard52h13, tagCustom48h12, tagCircle21h7,
    tagCircle49h12."""
    id: int = Field(ge=0)
    """Code of the tag."""
    size: TagSize
    """Side of the black square, edge to edge, measured on the print [m]; of the white square inside the black ring for
    the families with data outside their border (Standard, Custom, Circle)."""
    position: Metres3 = (0.0, 0.0, 0.0)
    """Centre of the tag in the target frame [m]."""
    rpy_deg: Metres3 | None = None
    """Roll, pitch, yaw of the tag in the target frame [deg]; a tag lying flat and upright is all zeros."""
    quaternion: tuple[float, float, float, float] | None = None
    """The same rotation as `(w, x, y, z)`; give this or `rpy_deg`."""
    position_sd: Metres3 = (0.0, 0.0, 0.0)
    """Standard deviation of `position`, by a survey [m]; poses of a map are less certain by it."""
    turn_sd_deg: Metres3 = (0.0, 0.0, 0.0)
    """Standard deviation of the rotation about the axes of the target, by a survey [deg]."""
    print: Literal["official", "opencv"] = "official"
    """Origin of the drawing: `opencv` for tags of cv2.aruco, which are upside down against the official prints."""

    @model_validator(mode="after")
    def _one_rotation(self) -> Self:
        if self.rpy_deg is not None and self.quaternion is not None:
            msg = "give rpy_deg or quaternion, not both"
            raise ValueError(msg)
        if self.quaternion is not None and sum(q * q for q in self.quaternion) < 1e-6:
            msg = "quaternion has no length; (1, 0, 0, 0) is not a rotation"
            raise ValueError(msg)
        return self


class BoardSection(Section):
    """A regular grid of tags, ids counting along the rows from the top left; the origin is the grid's centre."""

    family: str = "tag36h11"
    """AprilTag family."""
    first_id: int = Field(ge=0)
    """Id of the tag at the top left."""
    rows: int = Field(ge=1, le=40)
    """Number of rows."""
    columns: int = Field(ge=1, le=40)
    """Number of columns."""
    size: TagSize
    """Side of each black square [m]."""
    spacing: float = Field(gt=0)
    """White gap between neighbouring black squares [m]."""


Name = Annotated[str, Field(min_length=1, pattern=r"^[a-z0-9][a-z0-9_-]*$")]


class PlaceSection(Section):
    """A place in a target that has a name and a frame; a flight names it as it names a target."""

    name: Name
    """Name in results and on the bus; no target or other place has it."""
    tag: int | None = None
    """Code of the tag in whose middle the place lies; its x axis is that of the place."""
    position: Metres3 | None = None
    """Origin of the place in the target frame [m]; give this or `tag`."""
    yaw_deg: float = Field(default=0.0, ge=-360.0, le=360.0)
    """Turn of its axes about the up axis of the target, from the x axis of the target or of `tag` [deg]."""

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if (self.tag is None) == (self.position is None):
            msg = "give tag or position, one of them"
            raise ValueError(msg)
        return self


class TargetSection(Section):
    """One rigid thing with tags on it."""

    name: Name
    """Name in results and on the bus."""
    frame: str = ""
    """Name of its frame in `tf`; empty: the target's name."""
    moving: bool = False
    """Whether it moves in the world (another vehicle, a deck): its pose is relative only."""
    level: bool = True
    """Whether its xy plane is horizontal when at rest, so that the vehicle's roll and pitch are known against it."""
    bend: float = Field(default=0.003, ge=0.0, le=0.05)
    """How far its print may bend: rise of the centre over the middle of a side, standard deviation, as a share of the
    side. 0 for a print on a rigid board, 0.01 for loose paper."""
    tags: tuple[TagPlacement, ...] = ()
    """Tags placed one by one."""
    board: BoardSection | None = None
    """Tags placed as a grid."""
    places: tuple[PlaceSection, ...] = ()
    """Named places to take off from, fly to and land on."""
    map: Path | None = None
    """Tag map of another program (apriltag_ros bundle, TagSLAM, WPILib) whose tags this target has too; counts from the
    folder of this file."""
    family: str = "tag36h11"
    """AprilTag family of the tags of `map`: these files name none."""
    size: TagSize | None = None
    """Side of the black square of those tags of `map` that have none there [m]; WPILib never has."""


class TargetFile(Section):
    """A whole target file."""

    targets: tuple[TargetSection, ...]
    """The targets; a tag may belong to one of them only."""


class TrackerSection(Section):
    """Gates of the tracker; see docs/accuracy.md for the measurements behind the figures."""

    min_inlier_fraction: float = Field(default=0.35, gt=0, le=1)
    """Share of edge points that must agree.

    Lower publishes poses of half-hidden targets that are wrong."""
    min_points: int = Field(default=30, ge=12)
    """Edge points that must agree.

    Lower publishes poses of far targets that are uncertain."""
    max_rms_px: float = Field(default=1.0, gt=0)
    """Residual of the edge fit [px].

    Higher publishes poses that do not fit the image."""
    max_step: float = Field(default=0.02, gt=0)
    """Last step of the edge fit against the range.

    Higher publishes fits that have not converged."""
    redetect_period: float = Field(default=1.0, gt=0)
    """Longest time without a decoded tag [s].

    Longer keeps a wrong track for longer; shorter takes processor time."""
    coast: float = Field(default=0.6, gt=0, le=2.0)
    """Time without a pose for which a track is searched near its predicted position [s].

    Longer searches in the wrong place; shorter searches the whole image after each hidden target."""
    attitude_gate_deg: float = Field(default=3.0, gt=0)
    """Largest disagreement of roll and pitch with the vehicle's attitude, over a level target [deg].

    Narrower refuses correct poses if the boards' attitude is wrong; wider accepts mirrored poses."""
    attitude_sd_deg: float = Field(default=1.0, gt=0)
    """Standard deviation of the vehicle's roll and pitch, and of the target's level [deg].

    Smaller assumes that a tilted target is level."""
    max_attitude_age: float = Field(default=0.25, gt=0)
    """Attitude samples farther from the capture time are not used [s].

    Longer uses an old tilt."""


class VisionSection(Section):
    """Tracker of the daemon."""

    tracker: TrackerSection = TrackerSection()
    """When a pose is published."""
