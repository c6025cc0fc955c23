"""How much of the vehicle's attitude the eyes can use: what was left out is counted by reason, and told."""

from __future__ import annotations

from collections import Counter

from mkdaemon.telemetry.vision import Alarm, AttitudeLoss
from mkdaemon.vision.track.attitude import AttitudeHistory
from mkdaemon.vision.track.witness import AttitudeWitness


class AttitudeUse:
    """Counts images that were looked at without the attitude that was reported.

    Args:
        max_age: farthest a sample may be from an image [s].

    Attributes:
        lost: images by reason, since the start.
        alarms: what was wrong with the newest image's attitude, with what to do.
    """

    def __init__(self, max_age: float) -> None:
        self._max_age = max_age
        self.lost: Counter[AttitudeLoss] = Counter()
        self.alarms: dict[Alarm, str] = {}

    def image_seen(self, time: float, attitude: AttitudeHistory | None, witness: AttitudeWitness) -> None:
        """Count one image.

        Args:
            time: middle of its exposure [s].
            attitude: reported for it; none where nobody reports one.
            witness: what the images think of it.
        """
        self.alarms = {}
        if attitude is None or attitude.is_silent:
            return
        if attitude.at(time, self._max_age) is None:
            self.lost[AttitudeLoss.OUT_OF_REACH] += 1
            self.alarms[Alarm.ATTITUDE_MISSING] = self._missing_words(time, attitude)
        elif witness.contradicts:
            self.lost[AttitudeLoss.CONTRADICTS] += 1
            self.alarms[Alarm.ATTITUDE_CONTRADICTS] = (
                f"roll and pitch of the vehicle are {witness.off_deg:.0f} deg off what the images show of a level"
                " target: poses come from the images alone; check the camera's mount, the signs of the attitude, and"
                " `level` of the target"
            )

    def _missing_words(self, time: float, attitude: AttitudeHistory) -> str:
        if not attitude.samples:
            found = "none of the vehicle's attitudes is a number"
        else:
            away = min(abs(sample.time - time) for sample in attitude.samples)
            found = f"the nearest attitude of the vehicle is {away:.2f} s away from the image"
        return f"{found}: poses come from the images alone; check the link to the boards and the camera's stamps"
