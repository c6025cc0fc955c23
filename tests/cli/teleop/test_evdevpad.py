from __future__ import annotations

import pytest

pytest.importorskip("evdev", reason="evdev is not installed: pip install 'mkdaemon[teleop]'")

from lab.rigs.waiting import wait_until
from mkdaemon.cli.mkctl.teleop.devices import DeviceLostError
from mkdaemon.cli.mkctl.teleop.evdevpad import EvdevPad
from mkdaemon.client.teleop.inputs import AxisRange
from tests.cli.teleop.pipedpad import PipedPad

# The events are the kernel's structs, read by evdev itself; state and capabilities come from the rig.


class Reports(list[tuple[str, float]]):
    """Everything a pad reported."""

    def report(self, name: str, control: str, raw: float, at: float) -> None:
        self.append((control, raw))


async def test_events_are_reported_under_every_name_of_their_code() -> None:
    device, reports = PipedPad(), Reports()
    pad = EvdevPad(device, reports.report)
    device.move(ABS_X=1234, BTN_SOUTH=1)
    await wait_until(lambda: len(reports) >= 4)
    assert reports[0] == ("ABS_X", 1234)
    assert set(reports[1:]) == {("BTN_A", 1), ("BTN_GAMEPAD", 1), ("BTN_SOUTH", 1)}
    pad.close()


async def test_pad_is_asked_for_what_it_has_not_reported_and_names_ranges_buttons_and_radio() -> None:
    device = PipedPad(bustype=5)
    device.move(ABS_RY=-7, BTN_TL=1)
    pad = EvdevPad(device, Reports().report)
    state = pad.ask(3.5)
    assert state is not None
    assert state.at == 3.5
    assert (state.values["ABS_RY"], state.values["BTN_TL"], state.values["BTN_TR"]) == (-7, 1, 0)
    assert pad.facts.ranges["ABS_Z"] == AxisRange(0, 255)
    assert {"BTN_TL", "BTN_SOUTH"} <= pad.facts.buttons
    assert (pad.facts.is_wireless, pad.is_gamepad, pad.id) == (True, True, "045e:028e")
    pad.close()


@pytest.mark.parametrize("is_noticed", [True, False], ids=["it wakes the loop", "without an event"])
async def test_unplugged_pad_is_lost_when_asked(is_noticed: bool) -> None:
    device, reports = PipedPad(), Reports()
    pad = EvdevPad(device, reports.report)
    for _ in range(2):
        pad.alarm()
    assert device.shaken == 2
    if is_noticed:
        device.unplug()
        await wait_until(lambda: bool(reports))
    else:
        device._is_gone = True
    with pytest.raises(DeviceLostError, match="was unplugged"):
        pad.ask(1.0)
    pad.close()
