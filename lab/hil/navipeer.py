"""What a genuine NaviCtrl meets: the FlightCtrl's packets as the simulator's board would send them, compass and GPS."""

from __future__ import annotations

import itertools
import math
from collections import deque
from typing import Final

import numpy as np

from lab.hil.gpsreceiver import report
from lab.hil.navigation import NaviBoard, Socket
from lab.hil.spi import COMPATIBLE, ORDER, Word, packet
from mksim.boards.flightctrl import FlightCtrl
from mksim.boards.flightctrl_replies import bounded
from mksim.boards.line import HOST_CHAR
from mksim.physics.world import World

LEVEL_FIELD: Final = 200.0
DOWN_FIELD: Final = 420.0
"""Of the earth, in counts of the compass board."""
PERIOD: Final = 0.02
"""Between two packets [s]."""
BYTE_TIME: Final = 0.3e-3
"""Between two bytes of a packet [s]: the FlightCtrl sends them from its main loop."""
FIRST_REPORT: Final = 5.0
"""Of the GPS receiver, which takes longer to start than both boards [s]."""
LARGEST_VALUE: Final = 247
"""Of a parameter; larger ones name a potentiometer."""
FIRST_POTI_CHANNEL: Final = 5
VOLTS_OF_PACK: Final = 50
"""A low-voltage warning below this counts a cell [0.1 V]."""
GPS_PARAMETERS: Final = (
    *("gps_gain", "gps_p", "gps_i", "gps_d", "gps_acceleration", "gps_min_satellites", "gps_stick_threshold"),
    *("gps_operating_radius", "gps_wind_correction", "gps_speed_compensation", "gps_angle_limit"),
)
"""Of the word PARAMETERS, behind the pilot's switch."""


class Surroundings:
    """The compass and the GPS receiver of a NaviCtrl, in a simulated world."""

    def __init__(self, world: World) -> None:
        self._world, self._sequence, self._free_at = world, -1, 0.0

    def tend(self, board: NaviBoard, now: float) -> None:
        """Let the compass measure, and the receiver send what it has new."""
        enu_from_flu = self._world.truth.enu_from_flu
        forward, left, up = enu_from_flu.T @ np.array((0.0, LEVEL_FIELD, -DOWN_FIELD))
        board.lines.field[:] = [round(float(part)) for part in (forward, -left, -up)]
        board.lines.has_compass = 1
        fix = self._world.sensors.gps
        if fix.sequence == self._sequence or now < FIRST_REPORT:
            return
        self._sequence = fix.sequence
        begin = max(now, self._free_at)
        said = report(fix)
        board.receive(Socket.GPS, ((begin + k * HOST_CHAR, byte) for k, byte in enumerate(said, 1)))
        self._free_at = begin + len(said) * HOST_CHAR


class SimulatedMaster:
    """The simulator's FlightCtrl at the bus of a genuine NaviCtrl; it does not use that one's packets."""

    def __init__(self, flight: FlightCtrl) -> None:
        self._flight = flight
        self._words, self._left, self._due = itertools.cycle(ORDER), deque[tuple[float, int]](), 0.0

    def exchange(self, board: NaviBoard, until: float) -> None:
        """Exchange what is due until a time [s]."""
        while self._due <= until or self._left:
            if not self._left:
                said = self._next_packet()
                self._left.extend((self._due + k * BYTE_TIME, byte) for k, byte in enumerate(said, 1))
                self._due += PERIOD
            while self._left:
                if self._left[0][0] > until:
                    return
                board.exchange(*self._left.popleft())

    def _next_packet(self) -> bytes:
        word, sensors = next(self._words), self._flight.aircraft.sensors
        angles = (sensors.fc_angle_pitch, -sensors.fc_angle_roll)
        tilts = (-math.atan2(sensors.acc_x, 9.81), -math.atan2(sensors.acc_y, 9.81))
        motion = [bounded(math.degrees(angle) * 10.0) for angle in (*angles, *tilts)]
        said = packet(word, (*motion, round(sensors.heading_deg * 10.0) % 3600), self._data(word))
        if word is Word.USER:
            self._flight.core.take_pulses()
        return said

    def _data(self, word: Word) -> tuple[int, ...]:
        flight = self._flight
        core, live, sensors = flight.core, flight.live, flight.aircraft.sensors
        if word is Word.USER:
            return (*(0,) * 8, int(core.status(live)), flight.eeprom.active, 0, int(core.status_2()))
        if word is Word.STICK:
            sticks = core.receiver
            channels = (sticks.throttle, sticks.yaw, sticks.roll, sticks.pitch)
            return (*(round(channel) for channel in channels), *core.potis)
        if word is Word.PARAMETERS:
            return (self._gps_mode(), *(live[name] for name in GPS_PARAMETERS))
        if word is Word.MISC:
            height = _word(bounded(sensors.baro_height * 20.0))
            limits = (live["gps_p_limit"], live["gps_i_limit"], live["gps_d_limit"])
            throttle = core.reported_gas(live)
            return (0, live["gps_hold_delay"], *height, *height, *limits, core.quality, 0, throttle)
        if word is Word.VERSION:
            return (*flight.generation.release, COMPATIBLE, 22)
        if word is Word.BATTERY:
            current, used = round(sensors.battery_current * 10.0), round(sensors.battery_used_mah)
            voltage = round(sensors.battery_voltage * 10.0)
            return (*_word(current), *_word(used), voltage, self._low_voltage(), ord(" "))
        return ()

    def _gps_mode(self) -> int:
        """The pilot's switch, as the board's parameter or channel has it."""
        live, potis = self._flight.live, self._flight.core.potis
        if "gps_mode_channel" not in live:
            return min(LARGEST_VALUE, live.evaluate("gps_mode_control", potis))
        number = live["gps_mode_channel"] - FIRST_POTI_CHANNEL
        return min(LARGEST_VALUE, potis[number] if 0 <= number < len(potis) else 0)

    def _low_voltage(self) -> int:
        level = self._flight.live["low_voltage_warning"]
        return level * self._flight.core.cells if level < VOLTS_OF_PACK else level


def _word(value: int) -> tuple[int, int]:
    return value & 0xFF, value >> 8 & 0xFF
