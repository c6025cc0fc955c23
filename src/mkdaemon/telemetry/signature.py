"""The secret of a lease, and how a setpoint shows that it comes from the holder without giving the secret away.

Every client may subscribe to the keys of setpoints, so the secret itself never travels with one: it is the key of a
HMAC-SHA256 (RFC 2104) over the key's suffix, a zero byte and the payload, which travels as the sample's attachment. A
copy of an earlier setpoint is refused by its sequence.

A setpoint says when it was sent, by a clock of its sender's that only runs on: a stamp, signed with it, behind the
signature. The daemon learns from the stamps of a lease how that clock stands to its own (`mkdaemon.bus.senderclock`).
"""

import hmac
from dataclasses import dataclass, field
from typing import Final

SIGNATURE_BYTES: Final = 32
"""Length of a signature [bytes]."""
STAMP_BYTES: Final = 8
"""Length of a stamp behind it [bytes]: nanoseconds, unsigned, the most significant byte first."""
_NS: Final = 1_000_000_000


def sign(secret: str, suffix: str, payload: bytes, stamp: bytes = b"") -> bytes:
    """Sign a payload.

    Args:
        secret: of the lease, from the answer to `do/lease`.
        suffix: key it is put to, without `mk/<vehicle>/`.
        payload: as it is put.
        stamp: when it was sent; empty for none. With one, byte 1 and the stamp stand in the place of the zero byte.
    """
    return hmac.digest(secret.encode(), suffix.encode() + (b"\1" + stamp if stamp else b"\0") + payload, "sha256")


def stamped_proof(secret: str, suffix: str, payload: bytes, sent: float) -> bytes:
    """The attachment of a setpoint that says when it was sent: signature and stamp.

    Args:
        secret: of the lease.
        suffix: key it is put to, without `mk/<vehicle>/`.
        payload: as it is put.
        sent: now, by any clock of the sender's that is never set [s], for example `time.monotonic()`.
    """
    stamp = max(0, round(sent * _NS)).to_bytes(STAMP_BYTES)
    return sign(secret, suffix, payload, stamp) + stamp


def stamp_of(proof: bytes) -> float | None:
    """Send time of a setpoint, by its sender's clock [s]; None if its attachment has no stamp."""
    stamp = proof[SIGNATURE_BYTES:]
    return int.from_bytes(stamp) / _NS if len(stamp) == STAMP_BYTES else None


def private_key(secret: str, key: str) -> str:
    """The key below a plain one that only an owner of the secret can name; no wildcard matches its last chunk.

    Args:
        secret: shared by both sides.
        key: plain and whole.
    """
    return f"{key}/@{sign(secret, key, b'').hex()}"


@dataclass(frozen=True, slots=True)
class Signature:
    """Signature and stamp of a payload.

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
        found, stamp = self.proof[:SIGNATURE_BYTES], self.proof[SIGNATURE_BYTES:]
        return hmac.compare_digest(sign(secret, self.suffix, self.payload, stamp), found)


@dataclass(frozen=True, slots=True)
class HolderKey:
    """Tells setpoints of the holder of one lease from those of others; a new lease is a new key.

    Attributes:
        epoch: of the lease.
        secret: what only its holder knows.
        holder: its name.
    """

    epoch: int
    secret: str = field(repr=False)
    holder: str = ""

    def epoch_signed(self, signature: Signature) -> int | None:
        """Epoch of the lease whose holder signed this; None where he did not."""
        return self.epoch if signature.is_by(self.secret) else None


def signed(secret: str, suffix: str, payload: bytes) -> Signature:
    """Sign a payload and return both together."""
    return Signature(suffix, payload, sign(secret, suffix, payload))
