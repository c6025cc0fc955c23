"""A pad's node as a program of its own, which can be killed: it presses the enable button and rolls, for ever."""

from __future__ import annotations

import sys
import time

from tests.gateways.ros2.rosworld import LATCHED, PERIOD, joy, tutorial

IDLE = 20
"""Messages that the gateway hears first, the thrust stick lowest: what is held from the beginning does not count."""


def main(vehicle: str) -> None:
    with tutorial() as node:
        pad = node.say(f"/{vehicle}/joy", "sensor_msgs/msg/Joy")
        status = f"/{vehicle}/status"
        node.listen(status, "diagnostic_msgs/msg/DiagnosticStatus", LATCHED)
        heard = 0
        while True:
            heard += bool(pad.get_subscription_count())
            newest = node.newest(status)
            is_flying = newest is not None and any((one.key, one.value) == ("phase", "flying") for one in newest.values)
            axes = {"ABS_Y": 1.0} if heard < IDLE else {"ABS_RX": 0.5 * is_flying}
            pad.publish(joy(node, axes, () if heard < IDLE else ("BTN_TL",)))
            time.sleep(PERIOD)


if __name__ == "__main__":
    main(sys.argv[1])
