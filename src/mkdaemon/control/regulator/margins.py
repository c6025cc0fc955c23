"""Margins of the loop: tolerated differences from the model, and whether the configured limits are safe.

Everything linear about the loop is in its margins. Limits of tilt, sticks, their rates of change and the control rate
are not linear: with a value that is too small the aircraft swings or drifts away, though every eigenvalue is stable. So
the model is flown too: do the regulators, behind the configured limits, come to rest?
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.config.control import ControlConfig, LimiterConfig
from mkdaemon.control.estimator.model import GRAVITY, LEVEL_STATES, AircraftModel, D, E, H, P
from mkdaemon.control.estimator.values import GAS_CENTRE, Estimate
from mkdaemon.control.linear import Array, spectral_radius
from mkdaemon.control.regulator.autopilot import CountShaper
from mkdaemon.control.regulator.horizontal import COSTS, HorizontalRegulator
from mkdaemon.control.regulator.reference import Reference
from mkdaemon.control.regulator.vertical import VerticalGains, gas
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
"""Stick gains over the model's that a loop has to bear: the wrong models of docs/lab/control.md."""
LEAST_DELAY: Final = 0.02
"""Extra delay that a loop has to bear [s]: the wrong stamps of docs/lab/control.md."""
FARTHEST_REST: Final = 0.10
"""Largest distance from its goal at which the model may end its flight, see `fly_model` [m]."""
FLIGHT: Final = 12.0
"""Length of the flight on the model [s]."""
FLIGHT_END: Final = 3.0
"""Length of its end that is judged [s]."""
FLIGHT_FROM: Final = 0.5
"""Where it begins, from its goal [m]."""
FLIGHT_WIND: Final = 2.0
"""That it has to bear: the light wind of docs/lab/control.md [m/s]."""
HOVER_DOUBT: Final = 0.1
"""Thrust it must make up for, either way: an aircraft heavier or lighter than assumed [share of the weight]."""
_NOWHERE: Final = np.zeros(3)
_UNMOVED: Final = np.zeros((2, LEVEL_STATES))
_AT_REST: Final = np.zeros(4)


@dataclass(frozen=True, slots=True)
class Rest:
    """Distance of the model from its goal at the end.

    Attributes:
        level: largest horizontal distance along one axis [m].
        height: largest vertical distance [m].
    """

    level: float
    height: float


def gains_of(model: AircraftModel, cfg: ControlConfig) -> Gains:
    """Return model, gains and margins of the loop with its configured rate and limits.

    The gains are those over one target, the margins the smallest of all that are flown, with the true state; the
    estimator's own dynamics take a part of them.

    Args:
        model: of the aircraft.
        cfg: rate and limits.
    """
    period = 1.0 / cfg.rate
    f, g = model.horizontal(period)
    f, g = f[:7, :7], g[:7, None]
    gains = [each.gain for each in _regulators(model, cfg)]
    loops = f - g @ (np.array(FACTORS)[:, None, None, None] * np.array(gains)[:, None])
    radii = np.abs(np.linalg.eigvals(loops)).max(axis=(1, 2))
    stable = [factor for factor, radius in zip(FACTORS, radii, strict=True) if radius < 1.0]
    steps = min(
        next((count for count in range(1, MOST_STEPS) if _delayed_radius(f, g, gain, count) >= 1.0), MOST_STEPS)
        for gain in gains
    )
    rest = fly_model(model, cfg)
    return Gains(
        degrees_per_count=float(np.degrees(model.rad_per_count)),
        a1=model.a1,
        a2=model.a2,
        leak=model.leak,
        stick_filter=model.stick_filter,
        uplink=model.uplink,
        gains=dict(zip(NAMES, (float(value) for value in gains[0]), strict=True)),
        radius=max(spectral_radius(f - g @ gain[None]) for gain in gains),
        gain_margin=(min(stable, default=1.0), max(stable, default=1.0)),
        delay_margin=(steps - 1) * period,
        rest_level=rest.level,
        rest_height=rest.height,
        needed_gain=LEAST_GAIN,
        needed_delay=LEAST_DELAY,
        farthest_rest=FARTHEST_REST,
    )


def loop_refusal(model: AircraftModel, cfg: ControlConfig, found: Gains | None = None) -> CommandRejectedError | None:
    """Return why this loop must not be flown; None if it is safe on the model.

    Args:
        model: of the aircraft.
        cfg: rate and limits.
        found: its gains and margins, where they are known.
    """
    try:
        gains = found or gains_of(model, cfg)
    except ValueError as error:
        return refuse(Token.LOOP_UNSTABLE, detail=str(error), cause="this parameter set", remedy="fly the set Easy")
    if gains.is_safe:
        return None
    low, high = gains.gain_margin
    detail = (
        f"it bears {low:.2f} to {high:.2f} of the model's stick gain, {1000 * gains.delay_margin:.0f} ms more delay, "
        f"and ends a flight on the model {gains.rest_level:.2f} m beside and {gains.rest_height:.2f} m above or below "
        "its goal"
    )
    causes = {name: value for name, (value, wanted) in _options(cfg).items() if value != wanted}
    for name in causes:
        if gains_of(model, _with_default(cfg, name)).is_safe:
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
    loop[size - 1, :n] = -gain
    return spectral_radius(loop)


def fly_model(model: AircraftModel, cfg: ControlConfig) -> Rest:
    """Fly the model from beside and below its goal, in light wind, too heavy and too light, with the true state known.

    Args:
        model: of the aircraft.
        cfg: rate and limits.

    Raises:
        ValueError: the regulator stabilises nothing on this model.
    """
    beside = max(_rest_beside(model, cfg, regulator) for regulator in _regulators(model, cfg))
    return Rest(beside, max(_rest_above(model, cfg, sign * HOVER_DOUBT) for sign in (-1.0, 1.0)))


def _regulators(model: AircraftModel, cfg: ControlConfig) -> list[HorizontalRegulator]:
    """Those of everything that is flown by."""
    return [HorizontalRegulator(model, replace(costs, steepest=cfg.autopilot.max_tilt)) for costs in COSTS]


def _rest_beside(model: AircraftModel, cfg: ControlConfig, regulator: HorizontalRegulator) -> float:
    most = min(cfg.limiter.max_pitch, cfg.limiter.max_roll)
    period = 1.0 / cfg.rate
    f, g = model.horizontal(period)
    state = np.zeros(LEVEL_STATES)
    state[P], state[D] = FLIGHT_FROM, model.drag * FLIGHT_WIND
    goal, shaper, sent, worst = Reference(np.zeros(2)), CountShaper(-127, 127), 0.0, 0.0
    axes = np.zeros((2, LEVEL_STATES))
    for k in range(round(FLIGHT * cfg.rate)):
        axes[0] = state
        believed = _known_state(axes, _AT_REST)
        wanted = shaper.count(float(regulator.tilt(believed, goal)[0]) / model.rad_per_count)
        sent = _moved(sent, wanted, cfg.limiter.slew * min(period, 0.1), most)
        state = f @ state + g * (round(sent) * model.rad_per_count)
        if k / cfg.rate >= FLIGHT - FLIGHT_END:
            worst = max(worst, abs(float(state[P])))
    return worst


def _rest_above(model: AircraftModel, cfg: ControlConfig, doubt: float) -> float:
    """Largest height error at the end of a simulated flight, with whole counts and the limiter's slew rate [m]."""
    limits, period = cfg.limiter, 1.0 / cfg.rate
    hover = limits.hover_throttle + GAS_CENTRE
    f, g = model.vertical(period)
    # The state is known exactly: what remains is the limit cycle of the rounding and of the limiter.
    state = np.zeros(4)
    state[H], state[E] = -FLIGHT_FROM, GRAVITY * doubt
    shaper, sent, worst = CountShaper(-127, 127), limits.hover_throttle, 0.0
    gains = VerticalGains(fastest=cfg.autopilot.max_climb)
    for k in range(round(FLIGHT * cfg.rate)):
        believed = _known_state(_UNMOVED, state, hover)
        wanted = shaper.count(gas(believed, 0.0, 0.0, gains) - GAS_CENTRE)
        step = limits.throttle_slew * min(period, 0.1)
        sent = min(max(sent + min(max(wanted - sent, -step), step), limits.min_throttle), limits.max_throttle)
        state = f @ state + g * (((round(sent) + GAS_CENTRE) / hover) ** 2 - 1.0)
        if k / cfg.rate >= FLIGHT - FLIGHT_END:
            worst = max(worst, abs(float(state[H])))
    return worst


def _moved(last: float, wanted: float, step: float, most: float) -> float:
    moved = last + min(max(wanted - last, -step), step)
    return min(max(moved, -most), most)


def _known_state(axes: Array, vertical: Array, hover: float = 0.0) -> Estimate:
    """The true state, as the regulators take it."""
    return Estimate(
        at=0.0,
        yaw=0.0,
        hover_gas=hover,
        axes=axes,
        vertical=vertical,
        position_sd=_NOWHERE,
        age=0.0,
    )
