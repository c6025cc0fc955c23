"""The flight core: authority, manoeuvres and the output limiter. Pure."""
