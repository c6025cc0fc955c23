"""Linear systems: discretisation, and the steady gain of a linear quadratic regulator.

Shapes: `n` states, `m` inputs. Sources: C. Van Loan, "Computing integrals involving the matrix exponential", IEEE
Trans. Automatic Control 23 (1978); E. Chu et al., "A structure-preserving doubling algorithm for periodic
discrete-time algebraic Riccati equations", Int. J. Control 77 (2004).
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_TERMS: Final = 12
"""Terms of the Taylor series; with a norm below one half the rest is below 1e-13."""
ROUNDED: Final = 1e-9
"""A loop whose slowest motion lasts longer than a thousand million steps is one that never ends, rounded."""
_DOUBLINGS: Final = 60
"""Most steps of the doubling algorithm; it converges quadratically, in about ten."""


def exponential(matrix: Array) -> Array:
    """Return the matrix exponential, by scaling and squaring of the Taylor series."""
    norm = float(np.abs(matrix).sum(axis=1).max())
    squarings = max(0, int(np.ceil(np.log2(norm * 2.0)))) if norm > 0 else 0
    scaled = matrix / 2.0**squarings
    term = result = np.eye(len(matrix))
    for k in range(1, _TERMS + 1):
        term = term @ scaled / k
        result = result + term
    for _ in range(squarings):
        result = result @ result
    return result


def discretise(a: Array, b: Array, step: float) -> tuple[Array, Array]:
    """Turn x' = a x + b u into x+ = f x + g u for an input held over a step.

    Args:
        a: (n, n) [1/s].
        b: (n, m).
        step: [s].

    Returns:
        `f` (n, n) and `g` (n, m).
    """
    n, m = b.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = a, b
    whole = exponential(block * step)
    return whole[:n, :n].copy(), whole[:n, n:].copy()


def regulator_gain(f: Array, g: Array, state_cost: Array, input_cost: Array) -> tuple[Array, Array]:
    """Return the gain K (m, n) of the regulator u = -K x that minimises the sum of x'Qx + u'Ru, and that sum.

    The sum from a state x on is x'Px; P (n, n) is the second that is returned.

    Args:
        f: (n, n) transition.
        g: (n, m) input.
        state_cost: Q (n, n), positive semidefinite.
        input_cost: R (m, m), positive definite.

    Raises:
        ValueError: no gain stabilises the system.
    """
    identity = np.eye(len(f))
    a, h, q = f, g @ np.linalg.solve(input_cost, g.T), state_cost
    for _ in range(_DOUBLINGS):
        with np.errstate(over="ignore", invalid="ignore"):  # a state that cannot be reached grows without end
            # A <- A (I + H Q)^-1 A, H <- H + A (I + H Q)^-1 H A', Q <- Q + A' Q (I + H Q)^-1 A: after k rounds the sum
            # over 2^k steps, Q -> P. Source: Chu et al., as above.
            w = np.linalg.solve(identity + h @ q, np.concatenate([a, h], axis=1))
            wa, wh = w[:, : len(f)], w[:, len(f) :]
            step = a.T @ q @ wa
            h, q, a = h + a @ wh @ a.T, q + step, a @ wa
        if not (np.isfinite(q).all() and np.isfinite(h).all() and np.isfinite(a).all()):
            break
        if np.abs(step).max() <= 1e-12 * np.abs(q).max():
            # K = (R + g' P g)^-1 g' P F
            gain = np.asarray(np.linalg.solve(input_cost + g.T @ q @ g, g.T @ q @ f), dtype=np.float64)
            if spectral_radius(f - g @ gain) < 1.0 - ROUNDED:
                return gain, q
            break
    msg = "no gain stabilises this system"
    raise ValueError(msg)


def spectral_radius(f: Array) -> float:
    """Return the largest magnitude of an eigenvalue: below 1 the system x+ = f x is stable."""
    return float(np.abs(np.linalg.eigvals(f)).max())
