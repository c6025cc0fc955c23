"""Nobody flies past a gate that is shut, or that the pilot cannot shut."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lab.rigs.boardport import LineFault
from lab.rigs.cockpit import Boards, cockpit
from mkdaemon.config.control import ControlConfig, LeaseConfig
from mkdaemon.control.admission.beginnings import TakeLease
from mkdaemon.control.admission.rows import refusal
from mkdaemon.daemon.preflight import active_set
from mkdaemon.errors import CommandRejectedError
from mkdaemon.protocol.settings import ParameterSet
from mkdaemon.virtualtime import run_virtually
from mksim.boards.parameters import factory_set
from tests.control.admission.situations import GOOD


def taken(boards, gate, *, silent=False):
    """Take a lease; returns the token of the refusal, or None."""

    async def story():
        async with cockpit(boards, seed=1, sim={"gate_parameter": gate}) as flown:
            if silent:
                flown.socket.port.inject(LineFault.ECHO_ONLY)
            try:
                await flown.take("alice")
            except CommandRejectedError as error:
                assert silent or "ExternalControl" in error.reason
                assert silent or str(gate) in error.reason
                return error.token
            return None

    return run_virtually(story())


def lease_refusal(parameters):
    """Token of what prevents a lease with this set where the operator accepts a constant gate; None for nothing."""
    accepting = ControlConfig(lease=LeaseConfig(allow_constant_gate=True))
    now = replace(GOOD, cfg=accepting, active_set=active_set(parameters))
    error = refusal(TakeLease(holder="alice"), now)
    return None if error is None else error.token


@pytest.mark.parametrize(
    ("fc", "gate", "token"),
    [("early", 128, "gate_shut"), ("2.08", 129, "gate_constant"), ("2.12a", 247, "gate_constant"), ("2.14", 248, None)],
)
def test_the_gate_must_be_a_switch(fc, gate, token):
    assert taken(Boards(fc), gate) == token


@pytest.mark.parametrize(
    ("changes", "token"),
    [
        ({"global_config": 0x6B}, "gate_switches_altitude"),
        ({"global_config": 0x6A}, None),
        ({"global_config": 0x6B, "altitude_channel": 7}, None),
        ({"global_config": 0x6B, "external_control": 254}, None),
        ({"global_config": 0x6B, "external_control": 254, "altitude_channel": 6}, "gate_switches_altitude"),
    ],
)
def test_a_gate_that_also_switches_height_control_is_refused(changes, token):
    parameters = ParameterSet(factory_set(100, 3)).replaced({"external_control": 255, **changes})

    assert lease_refusal(parameters) == token
