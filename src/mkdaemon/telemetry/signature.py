"""The secret of a lease, and how a setpoint shows that it comes from the holder without giving the secret away.

Every client may subscribe to the keys of setpoints, so the secret itself never travels with one: it is the key of a
HMAC-SHA256 (RFC 2104) over the key's suffix, a zero byte and the payload, which travels as the sample's attachment. A
copy of an earlier setpoint is refused by its sequence.
"""

from __future__ import annotations

import hmac
from dataclasses import dataclass
from typing import Final

SIGNATURE_BYTES: Final = 32
"""Length of a signature [bytes]."""


def sign(secret: str, suffix: str, payload: bytes) -> bytes:
    """Sign a payload.

    Args:
        secret: of the lease, from the answer to `do/lease`.
        suffix: key it is put to, without `mk/<vehicle>/`.
        payload: as it is put.
    """
    return hmac.digest(secret.encode(), suffix.encode() + b"\0" + payload, "sha256")


@dataclass(frozen=True, slots=True)
class Signature:
    """What came with a payload.

    Attributes:
        suffix: key it came to.
        payload: as it came.
        proof: its attachment.
    """

    suffix: str
    payload: bytes
    proof: bytes

    def is_by(self, secret: str) -> bool:
        """Whether the holder of this secret signed it; takes the same time for every wrong proof."""
        return hmac.compare_digest(sign(secret, self.suffix, self.payload), self.proof)


def signed(secret: str, suffix: str, payload: bytes) -> Signature:
    """Sign a payload and return both together."""
    return Signature(suffix, payload, sign(secret, suffix, payload))
