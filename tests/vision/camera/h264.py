"""H.264 streams by hand: uncompressed key frames, and pictures that repeat them (ITU-T H.264, section 7.3)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Grey = npt.NDArray[np.uint8]


class _Bits:
    """Writes a unit bit by bit."""

    def __init__(self, *fields: tuple[int, int]) -> None:
        self.parts: list[Grey] = []
        self.write(*fields)

    def write(self, *fields: tuple[int, int]) -> None:
        """Add numbers, each with its count of bits."""
        for value, count in fields:
            self.parts.append(np.array([(value >> k) & 1 for k in reversed(range(count))], np.uint8))

    def golomb(self, *values: int) -> None:
        """Add unsigned Exp-Golomb numbers."""
        for value in values:
            count = (value + 1).bit_length()
            self.write((0, count - 1), (value + 1, count))

    def align(self, *, last: bool = False) -> None:
        """Fill the last byte."""
        if last:
            self.write((1, 1))
        self.write((0, -sum(map(len, self.parts)) % 8))

    def unit(self, header: int) -> bytes:
        """The unit behind its start code."""
        self.align(last=True)
        content = np.packbits(np.concatenate(self.parts)).tobytes()
        escaped, zeros = bytearray(), 0
        for byte in content:
            if zeros >= 2 and byte <= 3:
                escaped.append(3)
                zeros = 0
            escaped.append(byte)
            zeros = zeros + 1 if byte == 0 else 0
        return b"\0\0\0\1" + bytes([header]) + bytes(escaped)


def parameters(width: int, height: int) -> bytes:
    """Both parameter sets of a picture size that whole macroblocks make."""
    sequence = _Bits((66, 8), (0, 8), (40, 8))
    sequence.golomb(0, 0, 2, 1)
    sequence.write((0, 1))
    sequence.golomb(width // 16 - 1, height // 16 - 1)
    sequence.write((1, 1), (1, 1), (0, 1), (0, 1))
    picture = _Bits()
    picture.golomb(0, 0)
    picture.write((0, 2))
    picture.golomb(0, 0, 0)
    picture.write((0, 3))
    picture.golomb(0, 0, 0)
    picture.write((1, 1), (0, 2))
    return sequence.unit(0x67) + picture.unit(0x68)


def key_frame(pixels: Grey, number: int = 0) -> bytes:
    """A picture that stands alone; neighbouring ones have different numbers."""
    height, width = pixels.shape
    bits = _Bits()
    bits.golomb(0, 7, 0)
    bits.write((0, 4))
    bits.golomb(number)
    bits.write((0, 2))
    bits.golomb(0, 1)
    colour = np.unpackbits(np.full(128, 128, np.uint8))
    for y in range(0, height, 16):
        for x in range(0, width, 16):
            bits.golomb(25)  # I_PCM
            bits.align()
            bits.parts += [np.unpackbits(pixels[y : y + 16, x : x + 16].ravel()), colour]
    return parameters(width, height) + bits.unit(0x65)


def repeated(shape: tuple[int, ...], number: int) -> bytes:
    """A picture that repeats the one before, the `number`-th after its key frame."""
    bits = _Bits()
    bits.golomb(0, 5, 0)
    bits.write((number % 16, 4), (0, 3))
    bits.golomb(0, 1, shape[0] // 16 * (shape[1] // 16))
    return bits.unit(0x41)


def stream(pixels: Grey, count: int, number: int = 0) -> bytes:
    """A key frame and repetitions, `count` pictures together."""
    return key_frame(pixels, number) + b"".join(repeated(pixels.shape, k) for k in range(1, count))
