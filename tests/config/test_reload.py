"""What a running daemon takes up of a changed configuration."""

from __future__ import annotations

from mkdaemon.config.reader import load
from mkdaemon.config.reload import plan_reload


def test_what_can_be_taken_up_is_and_the_rest_is_named():
    running = load(None, {"link.port": "tcp:h:1"})
    wanted = load(
        None,
        {
            "link.port": "tcp:h:2",
            "vehicle.note": "new battery",
            "commands.allow_reset": True,
            "record.images.hz": 5.0,
            "control.limiter.max_pitch": 10,
            "cameras": [{"source": "/dev/video0"}],
            "sim": {"board": "fc"},
        },
    )
    plan = plan_reload(running, wanted)
    assert plan.taken == ("vehicle.note", "commands.allow_reset", "record.images.hz")
    assert plan.waiting == ("link.port", "control.limiter.max_pitch", "cameras")
    assert (plan.cfg.vehicle.note, plan.cfg.commands.allow_reset, plan.cfg.record.images.hz) == (
        "new battery",
        True,
        5.0,
    )
    assert (plan.cfg.link, plan.cfg.control, plan.cfg.cameras) == (running.link, running.control, ())


def test_nothing_differs_from_itself():
    plan = plan_reload(load(None), load(None))
    assert (plan.taken, plan.waiting, plan.cfg) == ((), (), load(None))
