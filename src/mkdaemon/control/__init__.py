"""What decides how the aircraft moves, pure: authority and the final limiter."""
