"""Is the vehicle alive? Not the same question as whether the daemon is."""

from mkdaemon.telemetry.base import Stamped


class VehicleHealth(Stamped):
    """The vehicle's own signs of life: `health`, at 1 Hz and on every change."""

    is_alive: bool
    """Frames of a board arrive: the link is up, degraded or one-way."""
    reason: str
    """Reason, one sentence."""
    boards: tuple[str, ...]
    """Boards that sent a frame since the line was opened."""
    firmware: dict[str, str]
    """Release of each board that answered a version request."""
    read_only: str | None
    """Why nothing that changes the aircraft is sent; null where control is possible."""
    link: str
    """State of the link, as in `link/state`."""
    motors_running: bool | None
    """Null where no message said so within the last two seconds."""
    error: str | None
    """The board's own error in words; null for none or unknown."""
    note: str
    """`vehicle.note` of the configuration."""
    battery_cells: int | None = None
    """Cells of the battery, counted by its highest voltage since the port was opened; null before it was reported."""
    open_endpoints: tuple[str, ...] = ()
    """Zenoh endpoints at which every program in the network can fly, because `bus.allow_open` is true."""
