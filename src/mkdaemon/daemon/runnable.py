"""Whether a configuration can run: what `mkdaemon run` refuses, and `mkdaemon doctor --config` prints."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial

from mkdaemon.bus.exposure import check_exposure
from mkdaemon.bus.session import session_config
from mkdaemon.clock import Clock
from mkdaemon.config.root import Config
from mkdaemon.control.regulator.margins import require_safe_loop
from mkdaemon.daemon.localsocket import check_group
from mkdaemon.errors import ConfigError
from mkdaemon.link.ports.port import parse_address
from mkdaemon.link.session.streams import check_rates


def mistakes(cfg: Config, *, needs_port: bool = True) -> Iterator[ConfigError]:
    """All mistakes of this configuration; nothing is opened, nothing is sent.

    What only this moment decides (a device that is not plugged in, an endpoint in use) is not looked at.

    Args:
        cfg: the configuration.
        needs_port: a port has to be set; a file without one is whole where `--port` names it.
    """
    checks: list[Callable[[], object]] = [
        *([partial(parse_address, cfg.link.port)] if needs_port or cfg.link.port else []),
        partial(check_rates, cfg.link),
        partial(_check_bus, cfg),
    ]
    if cfg.bus.local_group is not None:
        checks.append(partial(check_group, cfg.bus.local_group))
    if cfg.cameras or cfg.positions:
        checks.append(partial(require_safe_loop, cfg.control))
    checks += [source.secret for source in cfg.positions]
    checks.append(partial(_check_names, cfg))
    for check in checks:
        try:
            check()
        except ConfigError as error:
            yield error
    if cfg.cameras:
        yield from _camera_mistakes(cfg)


def require_runnable(cfg: Config) -> None:
    """Refuse a configuration that cannot run.

    Raises:
        ConfigError: the first mistake.
    """
    for mistake in mistakes(cfg):
        raise mistake


def _check_bus(cfg: Config) -> None:
    bus = cfg.bus
    config = session_config("peer", listen=bus.listen, connect=bus.connect, zenoh_file=bus.zenoh_file)
    check_exposure(config, allow_open=bus.allow_open)


def _check_names(cfg: Config) -> None:
    """Refuse a source of poses whose name a camera or another source has."""
    names = Counter([*(camera.name for camera in cfg.cameras), *(source.name for source in cfg.positions)])
    for source in cfg.positions:
        if names[source.name] > 1:
            raise ConfigError(f"positions: two sources or cameras are called '{source.name}'; rename one")


def _camera_mistakes(cfg: Config) -> Iterator[ConfigError]:
    try:
        from mkdaemon.vision.worker import camera_mistakes
    except ConfigError as error:  # OpenCV is not installed
        yield error
    else:
        yield from camera_mistakes(cfg.cameras, cfg.vision, Clock())
