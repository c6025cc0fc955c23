"""The simulated aircraft: boards, physics, radio, scene. Another port, never a branch in flight code."""
