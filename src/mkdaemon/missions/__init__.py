"""Mission files: GPX, KML, QGroundControl plan, CSV, the MikroKopter-Tool's and Mission Planner's lists.

A file that cannot be used is refused with one line naming the file, the line and the fix.
"""

from mkdaemon.missions.format import FORMATS, check_place, read_mission, write_mission
from mkdaemon.missions.source import AltitudeReference, MissionDraft

__all__ = ["FORMATS", "AltitudeReference", "MissionDraft", "check_place", "read_mission", "write_mission"]
