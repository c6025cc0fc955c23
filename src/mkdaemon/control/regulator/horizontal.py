"""Position to tilt sticks: a linear quadratic regulator of the whole axis, from the model.

The feed-forward is the equilibrium on the reference: with disturbance d, drag c and a reference that moves at v with
acceleration a, the true tilt is (a + c v - d) / g. The FlightCtrl's own tilt, which the stick must hold against the
leak, is (c v - d) / g + b. Before a jump of the reference's acceleration the aircraft must already tilt: the preview
adds the optimal input for the jumps ahead.

Sources: docs/control.md, "Regulator"; M. Tomizuka, "Optimal continuous finite preview problem", IEEE Trans. Automatic
Control 20 (1975).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np

from mkdaemon.control.estimator.model import GRAVITY, TH, US, AircraftModel, B, P, T, V, W
from mkdaemon.control.estimator.values import Estimate
from mkdaemon.control.linear import Array, regulator_gain, spectral_radius
from mkdaemon.control.regulator.reference import Reference

STEP: Final = 0.02
"""Control period [s]; sticks are evaluated every 22.5 ms, faster has no effect."""


@dataclass(frozen=True, slots=True)
class HorizontalCosts:
    """Weights of the regulator's cost.

    Attributes:
        position: [1/m2].
        velocity: [s2/m2].
        rate: of the tilt rate [s2/rad2].
        stick: of the wanted tilt [1/rad2].
        reach: largest position error that is regulated [m]; farther is the reference's business.
        steepest: largest wanted tilt [rad].
    """

    position: float = 6.0
    velocity: float = 0.6
    rate: float = 0.1
    stick: float = 3.0
    reach: float = 0.6
    steepest: float = 0.35


PREVIEW: Final = 30
"""Steps of the reference that are seen ahead: after 0.6 s a jump of its acceleration asks for nothing yet."""


EAGER: Final = 0.1
"""Share of the stick's cost with which a course is foreseen: its position counts more than quiet sticks."""


@lru_cache(maxsize=16)
def _solve(model: AircraftModel, costs: HorizontalCosts) -> tuple[Array, Array, float]:
    """Gain (7,), preview (PREVIEW,) and spectral radius.

    An autopilot is made at every tick until a flight begins, on the same aircraft.
    """
    f, g, gain, to_go = _optimum(model, costs)
    closed = f - g @ gain
    # A jump j of the wanted acceleration k steps ahead changes the error's tilt by -j / g. The optimal input for it is
    # (R + g' P g)^-1 g' (F - g K)'^k P e_T j / g. Source: Tomizuka, as above.
    row, ahead = np.linalg.solve(costs.stick * STEP + g.T @ to_go @ g, g.T)[0], []
    for _ in range(PREVIEW):
        ahead.append(float(row @ to_go[:, T]) / GRAVITY)
        row = row @ closed.T
    preview = np.array(ahead)
    gain.flags.writeable = preview.flags.writeable = False
    return gain[0], preview, spectral_radius(closed)


def _optimum(model: AircraftModel, costs: HorizontalCosts) -> tuple[Array, Array, Array, Array]:
    """Transition (7, 7) and input (7, 1) of an axis, and the gain (1, 7) and cost to go (7, 7) of its regulator."""
    f, g = model.horizontal(STEP)
    f, g = f[:7, :7], g[:7, None]
    weights = np.zeros(7)
    weights[[P, V, W]] = costs.position, costs.velocity, costs.rate
    gain, to_go = regulator_gain(f, g, np.diag(weights + 1e-9) * STEP, np.array([[costs.stick * STEP]]))
    return f, g, gain, to_go


@lru_cache(maxsize=16)
def _foresee(model: AircraftModel, costs: HorizontalCosts) -> tuple[Array, Array]:
    """Tilt to ask for now for changes of a course's acceleration and velocity at the next steps, (PREVIEW,) each.

    A model of the aircraft follows the course by preview with an eager regulator, and the aircraft follows the model by
    its own: u = u_model - K (x - x_model). Both are linear, so what is added for a change in k steps is what they do
    k steps before a single one.
    """
    gain = _optimum(model, costs)[2][0]
    eager = replace(costs, stick=EAGER * costs.stick)
    f, g, eager_gain, to_go = _optimum(model, eager)
    closed = f - g @ eager_gain
    row = np.linalg.solve(eager.stick * STEP + g.T @ to_go @ g, g.T)[0]
    tilts = np.zeros((7, 2))
    tilts[T, 0] = -1.0 / GRAVITY
    tilts[[T, TH, US], 1] = -model.drag / GRAVITY  # what drag needs of a velocity: of all three
    seen = []
    for _ in range(PREVIEW):
        seen.append(-row @ to_go @ tilts)
        row = row @ closed.T
    ahead, away = np.zeros((PREVIEW, 2)), np.zeros((7, 2))
    for k in range(PREVIEW - 1, -1, -1):
        asked = seen[k] - eager_gain[0] @ away
        ahead[k] = asked + gain @ away
        away = f @ away + g * asked
    ahead.flags.writeable = False
    return ahead[:, 0], ahead[:, 1]


class HorizontalRegulator:
    """Both horizontal axes.

    Attributes:
        gain: (7,) of position, velocity, true tilt, believed tilt, integral, rate, filtered stick.
        preview: (PREVIEW,) tilt to ask for now for a jump of the reference's acceleration at each of the next steps
            [rad s2/m].
        radius: spectral radius of the closed loop over `STEP`; below 1 is stable.
    """

    def __init__(self, model: AircraftModel, costs: HorizontalCosts) -> None:
        """Compute the gain.

        Raises:
            ValueError: the costs stabilise nothing.
        """
        self._model = model
        self._costs = costs
        self.gain, self.preview, self.radius = _solve(model.by_line(0.0), costs)

    def tilt(
        self, estimate: Estimate, reference: Reference, jumps: Array | None = None, gains: Array | None = None
    ) -> Array:
        """Return the tilt to ask for, towards x and y of the local frame (2,) [rad].

        Args:
            estimate: at the moment when the stick will act.
            reference: position, velocity and acceleration wanted, x and y.
            jumps: of that acceleration at each of the next `PREVIEW` steps (PREVIEW, 2) [m/s2]; None where it rests.
            gains: of its velocity at each of them (PREVIEW, 2) [m/s], where it is a course; None where it is not.
        """
        costs, drag = self._costs, self._model.drag
        error = estimate.axes[:, :7].copy()
        velocity = reference.velocity[:2]
        # Equilibrium at constant speed: g t = drag v - d; the FlightCtrl's own tilt and the stick are t + b. The wanted
        # acceleration a adds a / g to t alone. u = u_eq - K (x - x_eq) + sum of p_k (jump of a in k steps).
        pushed = (drag * velocity - estimate.disturbance) / GRAVITY
        held = pushed + estimate.axes[:, B]
        error[:, P] = np.minimum(np.maximum(error[:, P] - reference.position[:2], -costs.reach), costs.reach)
        error[:, V] -= velocity
        error[:, T] -= pushed + reference.acceleration[:2] / GRAVITY
        error[:, TH] -= held
        error[:, US] -= held
        wanted = held - error @ self.gain
        if jumps is not None and gains is not None:
            by_acceleration, by_velocity = _foresee(self._model.by_line(0.0), costs)
            wanted = wanted + by_acceleration @ jumps + by_velocity @ gains
        elif jumps is not None:
            wanted = wanted + self.preview @ jumps
        size = math.hypot(*wanted.tolist())
        return wanted if size <= costs.steepest else wanted * (costs.steepest / size)
