"""Times and limits of the verdict on a line."""

from __future__ import annotations

from typing import Final

SILENCE_TIME: Final = 0.35
"""Without a right frame for this long while some are due, we do not hear the board [s]."""
PROBE_PATIENCE: Final = 0.1
"""A probe unanswered for this long is followed by another at once [s]; radios of 2010 answer within 0.13 s."""
PROBES_MISSED: Final = 2
"""So many probes unanswered in a row, and the board does not hear us."""
STUCK_TIME: Final = 0.15
"""A port that has not taken our bytes for this long is stuck [s]."""
GARBAGE_BYTES: Final = 6
"""Fewer undecodable bytes than this within the silence are a glitch, not a wrong baud rate; `#av@w` has 6."""
GARBAGE_MEMORY: Final = 1.2
"""Once garbage was seen, it is not silence before nothing came for this long [s]."""
DAMAGE_LIMIT: Final = 0.1
"""Share of damaged among all received bytes above which the line counts as degraded."""
BOOT_TIME: Final = 6.0
"""A silence so long after boot text is still the boot [s]; a FlightCtrl takes 4.7 s."""
BOOT_LENGTH: Final = 700
"""More bytes than this within the silence are no boot text: a FlightCtrl prints 628 characters in all."""
HOLD: Final = 1.0
"""A line that was degraded is up again when nothing was wrong for so long [s]: what comes and goes is one verdict."""
PROBE_TIMEOUT: Final = 0.25
"""A link test without an answer for this long is lost [s]; the longest measured wait beside a saturated line is 27 ms,
the longest radio round trip 0.13 s."""
