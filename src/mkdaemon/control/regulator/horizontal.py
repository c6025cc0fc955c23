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
from dataclasses import dataclass
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


OVER_TARGET: Final = HorizontalCosts()
"""By cameras over one target, which a lean may take out of sight, and by a source of poses: docs/lab/positions.md, "The
regulator"."""
OVER_MAP: Final = HorizontalCosts(position=48.0, velocity=4.0, rate=0.4, stick=1.0)
"""By cameras over a map, of which a lean shows other tags; docs/lab/control.md, "Rooms"."""
COSTS: Final = (OVER_TARGET, OVER_MAP)
"""Everything that is flown by, the gentlest first."""
PREVIEW: Final = 30
"""Steps of the reference that are seen ahead: after 0.6 s a jump of its acceleration asks for nothing yet."""


@lru_cache(maxsize=48)
def _solve(model: AircraftModel, costs: HorizontalCosts) -> tuple[Array, Array, Array, float]:
    """Gain (7,), previews of acceleration and of velocity (PREVIEW,), and spectral radius.

    An autopilot is made at every tick until a flight begins, on the same aircraft.
    """
    f, g = model.horizontal(STEP)
    f, g = f[:7, :7], g[:7, None]
    weights = np.zeros(7)
    weights[[P, V, W]] = costs.position, costs.velocity, costs.rate
    stick_cost = np.array([[costs.stick * STEP]])
    gain, to_go = regulator_gain(f, g, np.diag(weights + 1e-9) * STEP, stick_cost)
    closed = f - g @ gain
    # A jump j of the wanted acceleration k steps ahead changes the error's tilt by -j / g. The optimal input for it is
    # (R + g' P g)^-1 g' (F - g K)'^k P e_T j / g. Source: Tomizuka, as above.
    # A change v of the wanted velocity changes the tilt against drag, true and believed, and the stick, by drag v / g.
    row, ahead, dragged = np.linalg.solve(stick_cost + g.T @ to_go @ g, g.T)[0], [], []
    for _ in range(PREVIEW):
        ahead.append(float(row @ to_go[:, T]) / GRAVITY)
        dragged.append(float(row @ to_go[:, [T, TH, US]].sum(axis=1)) * model.drag / GRAVITY)
        row = row @ closed.T
    preview, drag_preview = np.array(ahead), np.array(dragged)
    gain.flags.writeable = preview.flags.writeable = drag_preview.flags.writeable = False
    return gain[0], preview, drag_preview, spectral_radius(closed)


class HorizontalRegulator:
    """Both horizontal axes.

    Attributes:
        gain: (7,) of position, velocity, true tilt, believed tilt, integral, rate, filtered stick.
        preview: (PREVIEW,) tilt to ask for now for a jump of the reference's acceleration at each of the next steps
            [rad s2/m].
        drag_preview: the same for a change of its velocity [rad s/m].
        radius: spectral radius of the closed loop over `STEP`; below 1 is stable.
    """

    def __init__(self, model: AircraftModel, costs: HorizontalCosts) -> None:
        """Compute the gain.

        Raises:
            ValueError: the costs stabilise nothing.
        """
        self._model = model
        self._costs = costs
        self.gain, self.preview, self.drag_preview, self.radius = _solve(model.by_line(0.0), costs)

    def tilt(
        self, estimate: Estimate, reference: Reference, jumps: Array | None = None, gains: Array | None = None
    ) -> Array:
        """Return the tilt to ask for, towards x and y of the local frame (2,) [rad].

        Args:
            estimate: at the moment when the stick will act.
            reference: position, velocity and acceleration wanted, x and y.
            jumps: of that acceleration at each of the next `PREVIEW` steps (PREVIEW, 2) [m/s2]; None where it rests.
            gains: of its velocity at each of them (PREVIEW, 2) [m/s]; None where its way is not known.
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
        if jumps is not None:
            wanted = wanted + self.preview @ jumps
        if gains is not None:
            wanted = wanted + self.drag_preview @ gains
        size = math.hypot(*wanted.tolist())
        return wanted if size <= costs.steepest else wanted * (costs.steepest / size)
