"""How far the aircraft may differ from its model, and whether the loop with its configured limits is safe on it."""

from __future__ import annotations

from typing import Final

import numpy as np

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.config.control import ControlConfig, LimiterConfig
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.linear import Array, spectral_radius
from mkdaemon.control.regulator.horizontal import HorizontalCosts, HorizontalRegulator
from mkdaemon.control.regulator.modelflight import fly_model
from mkdaemon.errors import CommandRejectedError, ConfigError
from mkdaemon.telemetry.control import Gains
from mkdaemon.telemetry.refusals import Token, refuse

NAMES: Final = ("position", "velocity", "tilt", "believed tilt", "integral", "rate", "filtered stick")
"""What each gain acts on, in the order of the model's states."""
FACTORS: Final = tuple(float(factor) for factor in np.geomspace(0.05, 20.0, 241))
"""Stick gains that are tried, over the model's."""
MOST_STEPS: Final = 25
"""Longest extra delay that is tried [control periods]."""
LEAST_GAIN: Final = (0.67, 1.33)
"""Stick gains over the model's that a loop has to bear: the wrong models of docs/control.md."""
LEAST_DELAY: Final = 0.02
"""Extra delay that a loop has to bear [s]: the wrong stamps of docs/control.md."""
FARTHEST_REST: Final = 0.10
"""Largest distance from its goal at which the model may end its flight, see `fly_model` [m]."""


def gains_of(model: AircraftModel, cfg: ControlConfig) -> Gains:
    """Return model, gains and margins of the loop with its configured rate and limits.

    The margins are those of the loop with the true state; the estimator's own dynamics take a part of them.

    Args:
        model: of the aircraft.
        cfg: rate and limits.
    """
    regulator = HorizontalRegulator(model, HorizontalCosts(steepest=cfg.autopilot.max_tilt))
    period = 1.0 / cfg.rate
    f, g = model.horizontal(period)
    f, g = f[:7, :7], g[:7, None]
    gain = regulator.gain[None]
    stable = [factor for factor in FACTORS if spectral_radius(f - g @ (factor * gain)) < 1.0]
    steps = next((count for count in range(1, MOST_STEPS) if _delayed_radius(f, g, gain, count) >= 1.0), MOST_STEPS)
    rest = fly_model(model, cfg)
    return Gains(
        degrees_per_count=float(np.degrees(model.rad_per_count)),
        a1=model.a1,
        a2=model.a2,
        leak=model.leak,
        stick_filter=model.stick_filter,
        uplink=model.uplink,
        gains=dict(zip(NAMES, (float(value) for value in regulator.gain), strict=True)),
        radius=spectral_radius(f - g @ gain),
        gain_margin=(min(stable, default=1.0), max(stable, default=1.0)),
        delay_margin=(steps - 1) * period,
        rest_level=rest.level,
        rest_height=rest.height,
    )


def loop_refusal(model: AircraftModel, cfg: ControlConfig, found: Gains | None = None) -> CommandRejectedError | None:
    """Say why nobody may fly this loop; None where it is safe on the model.

    Args:
        model: of the aircraft.
        cfg: rate and limits.
        found: its gains and margins, where they are known.
    """
    try:
        gains = found or gains_of(model, cfg)
    except ValueError as error:
        return refuse(Token.LOOP_UNSTABLE, detail=str(error), cause="this parameter set", remedy="fly the set Easy")
    if _is_safe(gains):
        return None
    low, high = gains.gain_margin
    detail = (
        f"it bears {low:.2f} to {high:.2f} of the model's stick gain, {1000 * gains.delay_margin:.0f} ms more delay, "
        f"and ends a flight on the model {gains.rest_level:.2f} m beside and {gains.rest_height:.2f} m above or below "
        "its goal"
    )
    causes = {name: value for name, (value, wanted) in _options(cfg).items() if value != wanted}
    for name in causes:
        if _is_safe(gains_of(model, _with_default(cfg, name))):
            cause = f"control.{name} = {causes[name]:g}"
            remedy = f"set it to {_options(cfg)[name][1]:g}, or nearer"
            return refuse(Token.LOOP_UNSTABLE, detail=detail, cause=cause, remedy=remedy)
    cause = ", ".join(f"control.{name} = {value:g}" for name, value in causes.items()) or "this parameter set"
    remedy = "take them out of the configuration" if causes else "fly the set Easy"
    return refuse(Token.LOOP_UNSTABLE, detail=detail, cause=cause, remedy=remedy)


def require_safe_loop(cfg: ControlConfig) -> None:
    """Refuse a configuration with which the loop is not safe on the model of the set Easy; defaults are.

    Raises:
        ConfigError: an option is too small or too large; names it, the margin, and the remedy.
    """
    if all(value == wanted for value, wanted in _options(cfg).values()):
        return
    refusal = loop_refusal(AircraftModel(), cfg)
    if refusal is not None:
        msg = f"{refusal.reason} {refusal.fix}"
        raise ConfigError(msg)


def _is_safe(gains: Gains) -> bool:
    low, high = gains.gain_margin
    return (
        gains.radius < 1.0
        and low <= LEAST_GAIN[0]
        and high >= LEAST_GAIN[1]
        and gains.delay_margin >= LEAST_DELAY
        and max(gains.rest_level, gains.rest_height) <= FARTHEST_REST
    )


def _options(cfg: ControlConfig) -> dict[str, tuple[float, float]]:
    """Every option that the loop depends on: its value and its default."""
    options = {"rate": (cfg.rate, ControlConfig().rate)}
    for name in ("max_pitch", "max_roll", "min_throttle", "max_throttle", "slew", "throttle_slew", "hover_throttle"):
        options[f"limiter.{name}"] = (getattr(cfg.limiter, name), getattr(LimiterConfig(), name))
    for name in ("max_tilt", "max_climb"):
        options[f"autopilot.{name}"] = (getattr(cfg.autopilot, name), getattr(AutopilotConfig(), name))
    return options


def _with_default(cfg: ControlConfig, option: str) -> ControlConfig:
    """The configuration with one option at its default."""
    value = _options(cfg)[option][1]
    section, _, name = option.rpartition(".")
    if not section:
        return cfg.model_copy(update={name: value})
    return cfg.model_copy(update={section: getattr(cfg, section).model_copy(update={name: value})})


def _delayed_radius(f: Array, g: Array, gain: Array, steps: int) -> float:
    """Spectral radius of the loop whose stick acts some control periods late."""
    n = len(f)
    size = n + steps
    loop = np.zeros((size, size))
    loop[:n, :n] = f
    loop[:n, n : n + 1] = g
    for k in range(steps - 1):
        loop[n + k, n + k + 1] = 1.0
    loop[size - 1, :n] = -gain[0]
    return spectral_radius(loop)
