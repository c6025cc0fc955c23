"""Makes hostile files of good ones, each from its own seed."""

from __future__ import annotations

import os
import random
import re
import socket
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from lab.files.originals import Kind, originals
from lab.files.recordings import spoil_recording

Mutation = Callable[[random.Random, bytes], bytes]
LONG: Final = 2_000_000
"""Of a file that is one thing again and again [bytes]."""
SPARSE: Final = 256 << 30
"""Of a file of holes [bytes]."""
_NUMBER: Final = re.compile(rb"-?\d+(?:\.\d+)?")
_WORD: Final = re.compile(rb"[A-Za-z_]{3,}")
_ENCODING: Final = re.compile(rb'encoding="[^"]*"')
NUMBERS: Final = (
    *(b"nan", b"NaN", b"inf", b"-inf", b"Infinity", b"-Infinity", b"1e308", b"-1e308", b"1e400", b"1e-400"),
    *(b"0", b"-0", b"-1", b"255", b"256", b"65535", b"65536", b"2147483647", b"2147483648", b"4294967296"),
    *(b"9223372036854775807", b"9223372036854775808", b"18446744073709551615", b"99999999999999999999"),
    *(b"7" * 5000, b"0x10", b"1_0", b"true", b"null", b'""', b"[]", b"{}", b"'a'", b"", b"\xd9\xa3", b"1979-05-27"),
)
WORDS: Final = (
    *(b"", b"\0", b"\x1b]0;title\x07", b"../../../../etc/passwd", b"%s%n", b"__class__", b"\xff\xfe", b"a" * 70_000),
    *("\u202egnp".encode(), "\ud800".encode("utf-16-le", "surrogatepass"), b"\xed\xa0\x80", b"[bold]", b"{0}"),
)
ENCODINGS: Final = (
    *("utf-7", "idna", "zlib_codec", "base64_codec", "punycode", "rot13", "unicode_escape", "raw_unicode_escape"),
    *(
        "hex_codec",
        "undefined",
        "utf-16",
        "utf-32",
        "utf-8-sig",
        "cp037",
        "mbcs",
        "nothing",
        "latin-1",
        "bz2_codec",
        "",
    ),
)
REPEATED: Final = (
    *(b"\r", b"\n", b"#", b"\0", b" ", b"[", b"{", b"(", b",", b'"', b"'", b"=", b"a", b"\xff", b"\x1b", b"9"),
    *(b"<a>", b"<a/>", b"<!---->", b"a<!---->", b"a.", b"a=1\n", b"[a]\n", b'{"t":0,"dir":"rx","hex":""}\n', b"#a\r"),
    *(b"&amp;", b"[[a]]\n", b'"""', b"\\", b"//\n", b"/*", b"\x06" + bytes(8), b"\x89MCAP0\r\n", b"-1,", b"1;"),
)
"""What a long file consists of."""


def truncate(chance: random.Random, content: bytes) -> bytes:
    """Cut it off."""
    return content[: chance.randrange(len(content) + 1)]


def flip_bits(chance: random.Random, content: bytes) -> bytes:
    """Change some bits."""
    spoilt = bytearray(content)
    for _ in range(chance.choice((1, 1, 3, 20))):
        spoilt[chance.randrange(len(spoilt))] ^= 1 << chance.randrange(8)
    return bytes(spoilt)


def overwrite(chance: random.Random, content: bytes) -> bytes:
    """Put the largest, the smallest or any bytes somewhere: lengths and counts become giants."""
    at, size = chance.randrange(len(content)), chance.choice((1, 2, 4, 8, 16))
    filling = chance.choice((b"\xff" * size, bytes(size), b"\x7f" * size, chance.randbytes(size)))
    return content[:at] + filling + content[at + size :]


def duplicate(chance: random.Random, content: bytes) -> bytes:
    """Let a part stand there several times."""
    first, last = sorted(chance.randrange(len(content) + 1) for _ in range(2))
    return content[:last] + content[first:last] * chance.choice((1, 2, 50)) + content[last:]


def swap(chance: random.Random, content: bytes) -> bytes:
    """Swap two parts that lie beside each other."""
    first, middle, last = sorted(chance.randrange(len(content) + 1) for _ in range(3))
    return content[:first] + content[middle:last] + content[first:middle] + content[last:]


def remove(chance: random.Random, content: bytes) -> bytes:
    """Leave a part out."""
    first, last = sorted(chance.randrange(len(content) + 1) for _ in range(2))
    return content[:first] + content[last:]


def insert_noise(chance: random.Random, content: bytes) -> bytes:
    """Put random bytes into it."""
    at = chance.randrange(len(content) + 1)
    return content[:at] + chance.randbytes(chance.choice((1, 10, 1000))) + content[at:]


def change_number(chance: random.Random, content: bytes) -> bytes:
    """Write another number, or what is none."""
    return _replaced(chance, content, _NUMBER, chance.choice(NUMBERS))


def change_all_numbers(chance: random.Random, content: bytes) -> bytes:
    """Write another number for every one."""
    return _NUMBER.sub(chance.choice(NUMBERS).replace(b"\\", b"\\\\"), content)


def change_word(chance: random.Random, content: bytes) -> bytes:
    """Write another word."""
    return _replaced(chance, content, _WORD, chance.choice(WORDS))


def move_line(chance: random.Random, content: bytes) -> bytes:
    """Repeat, move or remove a line."""
    lines = content.splitlines(keepends=True) or [b""]
    line = lines.pop(chance.randrange(len(lines)))
    for _ in range(chance.choice((0, 1, 2, 5000))):
        lines.insert(chance.randrange(len(lines) + 1), line)
    return b"".join(lines)


def nest(chance: random.Random, content: bytes) -> bytes:
    """Nest something deep in place of a value or an element."""
    opening, closing = chance.choice(((b"[", b"]"), (b'{"a":', b"}"), (b"{a=", b"}"), (b"<a>", b"</a>"), (b"(", b")")))
    depth = chance.choice((70, 1000, 100_000))
    return _replaced(chance, content, _NUMBER, opening * depth + b"1" + closing * depth)


def lengthen(chance: random.Random, content: bytes) -> bytes:
    """Put one thing very often into it."""
    part = chance.choice(REPEATED)
    filling = part * (LONG // len(part))
    if chance.random() < 0.5:
        return _replaced(chance, content, _NUMBER, filling)
    lines = content.splitlines(keepends=True) or [b""]
    lines.insert(chance.randrange(len(lines) + 1), filling)
    return b"".join(lines)


def encode_otherwise(chance: random.Random, content: bytes) -> bytes:
    """Say, or use, another encoding."""
    name = chance.choice(ENCODINGS)
    if _ENCODING.search(content):
        return _ENCODING.sub(f'encoding="{name}"'.encode(), content)
    if content.lstrip().startswith(b"<"):
        return f'<?xml version="1.0" encoding="{name}"?>'.encode() + content
    try:
        return content.decode().encode(name)
    except (UnicodeError, LookupError):
        return b"\xff\xfe" + content


def _replaced(chance: random.Random, content: bytes, pattern: re.Pattern[bytes], by: bytes) -> bytes:
    found = list(pattern.finditer(content))
    if not found:
        return insert_noise(chance, content)
    place = chance.choice(found)
    return content[: place.start()] + by + content[place.end() :]


ANY: Final[tuple[Mutation, ...]] = (truncate, flip_bits, overwrite, duplicate, swap, remove, insert_noise)
TEXT: Final[tuple[Mutation, ...]] = (
    *(change_number, change_number, change_all_numbers, change_word, move_line, nest, encode_otherwise, lengthen),
)
_BINARY: Final = frozenset({Kind.BYTES, Kind.PICTURE, Kind.JPEG, Kind.CLIP, Kind.RECORDING})


def spoil(kind: Kind, seed: int) -> bytes:
    """A hostile file.

    Args:
        kind: of what it claims to be.
        seed: of what is done to it.
    """
    chance = random.Random(f"{kind.name} {seed}")
    content = chance.choice(originals(kind))
    if kind is Kind.RECORDING and chance.random() < 0.7:
        return spoil_recording(chance, content)
    mutations = ANY if kind in _BINARY else ANY + TEXT
    for _ in range(chance.choice((1, 1, 2, 4))):
        content = chance.choice(mutations)(chance, content) or b"\0"
    return content


def make_pipe(path: Path) -> None:
    """A pipe that nobody writes to."""
    os.mkfifo(path)


def make_folder(path: Path) -> None:
    """A folder with nothing in it."""
    path.mkdir()


def make_loop(path: Path) -> None:
    """A symbolic link to itself."""
    path.symlink_to(path.name)


def make_endless(path: Path) -> None:
    """A link to a device that never ends."""
    path.symlink_to("/dev/zero")


def make_dangling(path: Path) -> None:
    """A link to nothing."""
    path.symlink_to("not-there")


def make_socket(path: Path) -> None:
    """A socket."""
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))


def make_sparse(path: Path) -> None:
    """A file of holes."""
    path.touch()
    os.truncate(path, SPARSE)


def make_empty(path: Path) -> None:
    """A file without content."""
    path.touch()


def make_absent(path: Path) -> None:
    """No file."""


def make_endless_proc(path: Path) -> None:
    """A file of the system that cannot be read though it may be opened."""
    path.symlink_to("/proc/self/mem")


SPECIAL: Final[Mapping[str, Callable[[Path], None]]] = {
    "pipe": make_pipe,
    "folder": make_folder,
    "loop of links": make_loop,
    "/dev/zero": make_endless,
    "dangling link": make_dangling,
    "socket": make_socket,
    "sparse": make_sparse,
    "empty": make_empty,
    "absent": make_absent,
    "/proc/self/mem": make_endless_proc,
}
"""What stands where a file should, by its name."""
