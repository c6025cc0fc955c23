"""The whole simulated aircraft: line, boards, world and faults together, in virtual time."""

from __future__ import annotations

import pytest

from mkdaemon.protocol.framing import Frame, FrameDecoder, encode_frame
from mksim.config import ChannelConfig, PilotPlan, RadioConfig, RadioKind, SimConfig
from mksim.simulation import Simulation

DIRECT = RadioConfig(to_host=ChannelConfig())


class Host:
    """The far end of the line."""

    def __init__(self, **options):
        self.simulation = Simulation(SimConfig(**{"radio": DIRECT, **options}))
        self._decoder = FrameDecoder()
        self.heard = []

    def run(self, seconds):
        """Run on and return the frames that came."""
        before = len(self.heard)
        steps = round(seconds / 0.002)
        for _ in range(steps):
            for at, data in self.simulation.advance(self.simulation.now + 0.002):
                self.heard += [(at, item) for item in self._decoder.feed(data) if isinstance(item, Frame)]
        return self.heard[before:]

    def ask(self, frame, seconds=0.3):
        """Send and return the letters that came."""
        self.simulation.write(frame, self.simulation.now)
        return "".join(frame.id for _, frame in self.run(seconds))


@pytest.mark.parametrize(("board", "address"), [("nc", 2), ("fc", 1)])
def test_the_board_whose_port_it_is_answers(board, address):
    host = Host(board=board, pilot_plan=PilotPlan.NOTHING)
    assert host.ask(encode_frame(0, "v")) == "V"
    assert host.heard[0][1].address == address


@pytest.mark.parametrize(
    ("direction", "answers", "arrives"), [("both", "", False), ("to_board", "", False), ("to_host", "", True)]
)
def test_a_cut_link(direction, answers, arrives):
    host = Host(pilot_plan=PilotPlan.NOTHING)
    host.simulation.world.faults.start("link_cut", direction=direction)
    host.run(0.1)
    assert host.ask(encode_frame(2, "j", bytes([1, 9, 77, 0]))) == answers
    assert (host.simulation.navigation.parameters.get(9) == 77) is arrives
    host.simulation.world.faults.stop("link_cut")
    host.run(0.1)
    assert host.ask(b"\r" + encode_frame(2, "v")) == "V"


def test_an_xbee_adds_its_latency_both_ways():
    xbee = ChannelConfig(kind=RadioKind.XBEE, loss=0.0)
    host = Host(radio=RadioConfig(to_board=xbee, to_host=xbee), pilot_plan=PilotPlan.NOTHING)
    host.run(0.5)
    for _ in range(40):
        sent = host.simulation.now
        host.ask(encode_frame(2, "z", b"\x01\x00"), 0.2)
        assert 0.026 < host.heard[-1][0] - sent < 0.15


@pytest.mark.parametrize("plan", [plan for plan in PilotPlan if plan is not PilotPlan.NOTHING])
def test_every_plan_waits_20_s_unless_told_otherwise(plan):
    """The sticks stay at rest, throttle down, although a machine already asks for control."""
    control = encode_frame(1, "b", bytes([0, 0, 0, 0, 0, 1, 0]))

    def moved_at(**options):
        host = Host(board="fc", pilot_plan=plan, calibrated=True, **options)
        pilot = host.simulation.world.pilot
        while host.simulation.now < 26.0:
            host.simulation.write(control, host.simulation.now)
            host.run(0.25)
            if (pilot.pitch, pilot.roll, pilot.yaw, pilot.gas) != (0, 0, 0, -127):
                return host.simulation.now
        return None

    assert moved_at() == pytest.approx(20.1, abs=0.4)
    assert moved_at(pilot_wait=5.0) == pytest.approx(5.1, abs=0.4)


def test_the_pilot_begins_when_he_is_asked():
    host = Host(pilot_plan=PilotPlan.HOVER)
    host.run(3.0)
    assert host.simulation.world.pilot.gas == -127
    host.simulation.start_pilot()
    host.run(0.2)
    assert host.simulation.world.pilot.gas == 127, "he calibrates first"
    Host(pilot_plan=PilotPlan.NOTHING).simulation.start_pilot()


def test_the_pilot_says_what_he_waits_for():
    def doing(plan, seconds):
        host = Host(pilot_plan=plan, pilot_wait=0.5)
        said = [host.simulation.pilot_doing]
        host.run(seconds)
        return [*said, host.simulation.pilot_doing]

    waits = "waits 0.5 s before he touches the sticks; `mkctl sim start` asks him earlier"
    started = "has started the motors, throttle at its lowest and waits for a machine: `mkctl take-off`, `fly`"
    assert doing(PilotPlan.START, 8.0) == [waits, started]
    assert doing(PilotPlan.SUPERVISE, 14.0)[-1].startswith("hovers by hand and waits for a machine")
    assert doing(PilotPlan.WAIT, 1.0)[-1] == "waits for a machine to start the motors and take off"
    assert doing(PilotPlan.HOVER, 14.0)[-1] == "flies by hand"
    assert doing(PilotPlan.NOTHING, 1.0) == ["leaves his sticks alone (nothing)"] * 2


def test_the_pilot_flies_once_more_when_he_is_asked_after_a_landing():
    host = Host(pilot_plan=PilotPlan.HOVER, pilot_wait=0.0, calibrated=True)
    host.run(9.0)
    host.simulation.start_pilot()
    host.run(0.1)
    assert host.simulation.world.truth.airborne, "he flies: nothing begins anew"
    host.simulation.world.pilot.program.program.land()
    host.run(15.0)
    assert host.simulation.pilot_doing == "has stopped the motors"
    host.simulation.start_pilot()
    host.run(9.0)
    assert host.simulation.world.truth.airborne


def test_a_reboot_in_flight_ends_it():
    host = Host(pilot_plan=PilotPlan.HOVER, pilot_wait=0.0)
    host.run(9.0)
    assert host.simulation.world.truth.airborne
    host.simulation.world.faults.start("fc_reboot")
    host.run(0.1)
    assert not host.simulation.flight.core.running
    assert not host.simulation.world.faults.is_active("fc_reboot")
    host.run(4.0)
    assert host.simulation.world.truth.crashed


def test_the_gate_fault_takes_the_sticks_away():
    host = Host(pilot_plan=PilotPlan.NOTHING, calibrated=True)
    host.simulation.flight.core.start()
    control = encode_frame(1, "b", bytes([30, 0, 0, 0, 1, 1, 0]))
    host.ask(control, 0.1)
    assert host.simulation.flight.core.controlled
    host.simulation.world.faults.start("gate_closed")
    host.ask(control, 0.1)
    assert not host.simulation.flight.core.controlled


def test_nothing_is_armed_and_no_gate_is_open_from_the_factory():
    host = Host(pilot_plan=PilotPlan.NOTHING, gate_parameter=0)
    host.run(0.5)
    core = host.simulation.flight.core
    assert not core.running
    assert not core.calibrated
    assert not core.gate_open


def test_the_eeprom_file_outlives_the_simulation(tmp_path):
    path = tmp_path / "fc.json"
    host = Host(board="fc", eeprom=path, pilot_plan=PilotPlan.NOTHING)
    written = host.simulation.flight.eeprom.sets[2]
    assert host.ask(encode_frame(1, "s", b"\x02" + written), 1.5) == "S"
    again = Host(board="fc", eeprom=path, pilot_plan=PilotPlan.NOTHING)
    assert again.simulation.flight.eeprom.active == 2
