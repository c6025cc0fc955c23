"""The whole simulated aircraft: line, boards, world and faults together, in virtual time."""

from __future__ import annotations

import pytest

from mkdaemon.protocol.framing import Frame, FrameDecoder, encode_frame
from mksim.config import ChannelConfig, PilotPlan, RadioConfig, SimConfig
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
