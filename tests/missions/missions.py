"""Random missions for round trips, and one everybody can read."""

from __future__ import annotations

from hypothesis import strategies as st

from mkdaemon.telemetry.mission import Mission, MissionPoint, PointKind

ROUND = Mission(
    name="Round",
    points=(
        MissionPoint(latitude_deg=53.0712345, longitude_deg=8.7912345, altitude=1.0, kind=PointKind.POI, name="POI"),
        MissionPoint(
            latitude_deg=53.0722222, longitude_deg=8.7922222, altitude=15.0, radius=3, hold=5, poi=1, climb=2.5,
            speed=4.5, camera_angle_deg=255, name="P1", event=100, photo_distance=10,
        ),
        MissionPoint(latitude_deg=53.0733333, longitude_deg=8.7933333, altitude=20.0, heading_deg=360, name="P2"),
    ),
)  # fmt: skip


def degrees(limit: int) -> st.SearchStrategy[float]:
    """Angles on the 1e-7 degree grid of the wire."""
    return st.integers(-limit * 10**7, limit * 10**7).map(lambda counts: counts / 1e7)


def tenths(limit: int) -> st.SearchStrategy[float]:
    return st.integers(0, limit).map(lambda counts: counts / 10)


@st.composite
def missions(draw: st.DrawFn, *, whole_metres: bool = False, max_size: int = 3) -> Mission:
    """Missions on the grid of the wire; the first point is a POI half of the time."""
    has_poi = draw(st.booleans())
    points = []
    for number in range(draw(st.integers(1, max_size))):
        is_poi = has_poi and number == 0
        altitude = draw(st.integers(-500, 6000)) if whole_metres else draw(st.integers(-5000, 60000)) / 10
        heading = draw(st.none() | st.integers(1, 360))
        looks = has_poi and not is_poi and draw(st.booleans())
        kinds = [PointKind.WAYPOINT, PointKind.FAILSAFE, PointKind.LAND]
        points.append(
            MissionPoint(
                latitude_deg=draw(degrees(90)),
                longitude_deg=draw(degrees(180)),
                altitude=altitude,
                kind=PointKind.POI if is_poi else draw(st.sampled_from(kinds)),
                radius=draw(st.integers(0, 255)),
                hold=draw(st.integers(0, 255)),
                heading_deg=None if looks else heading,
                poi=1 if looks else None,
                climb=draw(tenths(255)),
                speed=draw(tenths(255)),
                camera_angle_deg=draw(st.integers(0, 255)),
                name=draw(st.text("ABCxyz019_&<>'\"", max_size=4)),
                event=draw(st.integers(0, 255)),
                photo_distance=draw(st.integers(0, 255)),
            )
        )
    return Mission(points=tuple(points))
