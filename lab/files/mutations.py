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


def _truncate(chance: random.Random, content: bytes) -> bytes:
    return content[: chance.randrange(len(content) + 1)]


def _flip_bits(chance: random.Random, content: bytes) -> bytes:
    spoilt = bytearray(content)
    for _ in range(chance.choice((1, 1, 3, 20))):
        spoilt[chance.randrange(len(spoilt))] ^= 1 << chance.randrange(8)
    return bytes(spoilt)


def _overwrite(chance: random.Random, content: bytes) -> bytes:
    """Put the largest, the smallest or any bytes somewhere: lengths and counts become giants."""
    at, size = chance.randrange(len(content)), chance.choice((1, 2, 4, 8, 16))
    filling = chance.choice((b"\xff" * size, bytes(size), b"\x7f" * size, chance.randbytes(size)))
    return content[:at] + filling + content[at + size :]


def _duplicate(chance: random.Random, content: bytes) -> bytes:
    """Let a part stand there several times."""
    first, last = sorted(chance.randrange(len(content) + 1) for _ in range(2))
    return content[:last] + content[first:last] * chance.choice((1, 2, 50)) + content[last:]


def _swap(chance: random.Random, content: bytes) -> bytes:
    first, middle, last = sorted(chance.randrange(len(content) + 1) for _ in range(3))
    return content[:first] + content[middle:last] + content[first:middle] + content[last:]


def _remove(chance: random.Random, content: bytes) -> bytes:
    first, last = sorted(chance.randrange(len(content) + 1) for _ in range(2))
    return content[:first] + content[last:]


def _insert_noise(chance: random.Random, content: bytes) -> bytes:
    at = chance.randrange(len(content) + 1)
    return content[:at] + chance.randbytes(chance.choice((1, 10, 1000))) + content[at:]


def _change_number(chance: random.Random, content: bytes) -> bytes:
    """Write another number, or what is none."""
    return _replaced(chance, content, _NUMBER, chance.choice(NUMBERS))


def _change_all_numbers(chance: random.Random, content: bytes) -> bytes:
    """Write another number for every one."""
    return _NUMBER.sub(chance.choice(NUMBERS).replace(b"\\", b"\\\\"), content)


def _change_word(chance: random.Random, content: bytes) -> bytes:
    return _replaced(chance, content, _WORD, chance.choice(WORDS))


def _move_line(chance: random.Random, content: bytes) -> bytes:
    """Repeat, move or remove a line."""
    lines = content.splitlines(keepends=True) or [b""]
    line = lines.pop(chance.randrange(len(lines)))
    for _ in range(chance.choice((0, 1, 2, 5000))):
        lines.insert(chance.randrange(len(lines) + 1), line)
    return b"".join(lines)


def _nest(chance: random.Random, content: bytes) -> bytes:
    """Nest something deep in place of a value or an element."""
    opening, closing = chance.choice(((b"[", b"]"), (b'{"a":', b"}"), (b"{a=", b"}"), (b"<a>", b"</a>"), (b"(", b")")))
    depth = chance.choice((70, 1000, 100_000))
    return _replaced(chance, content, _NUMBER, opening * depth + b"1" + closing * depth)


def _lengthen(chance: random.Random, content: bytes) -> bytes:
    """Put one thing very often into it."""
    part = chance.choice(REPEATED)
    filling = part * (LONG // len(part))
    if chance.random() < 0.5:
        return _replaced(chance, content, _NUMBER, filling)
    lines = content.splitlines(keepends=True) or [b""]
    lines.insert(chance.randrange(len(lines) + 1), filling)
    return b"".join(lines)


def _encode_otherwise(chance: random.Random, content: bytes) -> bytes:
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
        return _insert_noise(chance, content)
    place = chance.choice(found)
    return content[: place.start()] + by + content[place.end() :]


ANY: Final[tuple[Mutation, ...]] = (_truncate, _flip_bits, _overwrite, _duplicate, _swap, _remove, _insert_noise)
TEXT: Final[tuple[Mutation, ...]] = (
    *(
        _change_number,
        _change_number,
        _change_all_numbers,
        _change_word,
        _move_line,
        _nest,
        _encode_otherwise,
        _lengthen,
    ),
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


def _bind(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))


def _make_sparse(path: Path) -> None:
    path.touch()
    os.truncate(path, SPARSE)


SPECIAL: Final[Mapping[str, Callable[[Path], None]]] = {
    "pipe": os.mkfifo,
    "folder": Path.mkdir,
    "loop of links": lambda path: path.symlink_to(path.name),
    "/dev/zero": lambda path: path.symlink_to("/dev/zero"),
    "dangling link": lambda path: path.symlink_to("not-there"),
    "socket": _bind,
    "sparse": _make_sparse,
    "empty": Path.touch,
    "absent": lambda path: None,
    "/proc/self/mem": lambda path: path.symlink_to("/proc/self/mem"),  # it may be opened, and not be read
}
"""What stands where a file should, by its name."""
