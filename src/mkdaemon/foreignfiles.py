"""Reads foreign files, with limits; no other module opens them.

Only regular files are read, up to a limit of length and of nesting. Nothing here blocks, as opening a pipe would. Other
errors of Python's parsers (`RecursionError`, a number with 5,000 digits) are raised as parser errors.
"""

from __future__ import annotations

import errno
import io
import json
import os
import re
import stat
import tomllib
from codecs import BOM_UTF8
from pathlib import Path
from typing import Any, BinaryIO, Final

from mkdaemon.errors import ConfigError

LONGEST_TEXT: Final = 4_000_000
"""Longest text file [bytes]."""
LONGEST_SETTINGS: Final = 500_000
"""Longest configuration, mapping, camera, target, script, mixer or settings file [bytes]; ours have up to 10,000. The
readers need about 1 s of processor time for one that is full of mistakes."""
LONGEST_CAPTURE: Final = 1_000_000_000
"""Longest file of recorded bytes, or of lines with such [bytes]: two days of a busy line."""
LONGEST_PICTURE: Final = 1 << 28
"""Longest picture file [bytes]: 64 million pixels, four bytes each."""
DEEPEST: Final = 64
"""Deepest nesting of a document; ours need fewer than ten."""


class _NamedFile(io.FileIO):
    """An open file that adds its name to errors, for example when the disk fails during a read."""

    def __init__(self, number: int, path: Path) -> None:
        super().__init__(number, "rb")
        self._path = path

    def readinto(self, buffer: Any, /) -> int | None:
        try:
            return super().readinto(buffer)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self._path)) from error


def open_regular(path: Path, limit: int | None = None) -> BinaryIO:
    """Open a regular file for reading bytes; what fails later names it too.

    Args:
        path: the file.
        limit: longest file [bytes]; None for any length.

    Raises:
        OSError: it cannot be opened, is a folder, pipe, socket or device, or too long.
    """
    number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    file = io.BufferedReader(_NamedFile(number, path))
    try:
        found = os.fstat(number)
        if stat.S_ISDIR(found.st_mode):
            raise OSError(errno.EISDIR, "a folder and no file", str(path))
        if not stat.S_ISREG(found.st_mode):
            raise OSError(errno.EINVAL, "no regular file", str(path))
        if limit is not None and found.st_size > limit:
            raise OSError(errno.EFBIG, f"larger than {limit / 1e6:.4g} MB", str(path))
    except OSError:
        file.close()
        raise
    return file


def read_bytes(path: Path, limit: int) -> bytes:
    """Read a regular file.

    Raises:
        OSError: see `open_regular`.
    """
    with open_regular(path, limit) as file:
        return file.read(limit)


def read_text(path: Path, *, encoding: str = "utf-8-sig", limit: int = LONGEST_TEXT) -> str:
    """Read a regular text file; a byte order mark before it is not a part of the text.

    Raises:
        OSError: see `open_regular`.
        UnicodeDecodeError: it is not text in this encoding.
    """
    return read_bytes(path, limit).decode(encoding).replace("\r\n", "\n")


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML.

    Raises:
        tomllib.TOMLDecodeError: it is none, nests too deep, or has a number with thousands of digits.
    """
    if _has_long_key(text):
        raise tomllib.TOMLDecodeError(_TOO_DEEP)
    try:
        tree = tomllib.loads(text.removeprefix("\ufeff"))
    except RecursionError:
        raise tomllib.TOMLDecodeError(_TOO_DEEP) from None
    except tomllib.TOMLDecodeError:
        raise
    except ValueError as error:
        raise tomllib.TOMLDecodeError(_TOO_MANY_DIGITS) from error
    if _is_deep(tree):
        raise tomllib.TOMLDecodeError(_TOO_DEEP)
    return tree


def parse_json(text: str | bytes) -> Any:
    """Parse JSON.

    Raises:
        json.JSONDecodeError: it is none, nests too deep, or has a number with thousands of digits.
    """
    try:
        tree = json.loads(text.removeprefix("\ufeff") if isinstance(text, str) else text.removeprefix(BOM_UTF8))
    except RecursionError:
        raise json.JSONDecodeError(_TOO_DEEP, "", 0) from None
    except json.JSONDecodeError:
        raise
    except ValueError as error:
        what = "not UTF-8 text" if isinstance(error, UnicodeDecodeError) else _TOO_MANY_DIGITS
        raise json.JSONDecodeError(what, "", 0) from error
    if _is_deep(tree):
        raise json.JSONDecodeError(_TOO_DEEP, "", 0)
    return tree


def parse_yaml(text: str) -> Any:
    """Parse a document of YAML: dicts, lists, texts, numbers, True, False and None.

    Raises:
        ConfigError: it is none, holds tags that only one program knows, or nests too deep; names the line.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    try:
        tree = YAML(typ="safe", pure=True).load(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = "" if mark is None else f"line {mark.line + 1}: "
        raise ConfigError(f"{line}{error.problem or error.context}") from None
    except RecursionError:
        raise ConfigError(_TOO_DEEP) from None
    except (YAMLError, ValueError, TypeError) as error:
        raise ConfigError(f"it is no YAML: {' '.join(str(error).split())}") from None
    if _is_deep(tree):
        raise ConfigError(_TOO_DEEP)
    return tree


def parse_number(text: str) -> float:
    """Parse a decimal number of a text file; Python itself reads `1_5` as 15, and digits of every script.

    Raises:
        ValueError: it is none. Infinity and NaN are numbers here.
    """
    if "_" in text or not text.isascii():
        raise ValueError(f"{text.strip()!r} is not a number")
    return float(text)


_TOO_DEEP: Final = f"it nests deeper than {DEEPEST}"
_TOO_MANY_DIGITS: Final = "a number has thousands of digits"


_BETWEEN_KEYS: Final = re.compile(r"[^\w\-.\"' \t]+")
_DOT_IN_KEY: Final = re.compile(r"[\w\-\"'][ \t]*\.(?=[ \t]*[\w\-\"'])")


def _has_long_key(text: str) -> bool:
    """Whether a dotted key has more than `DEEPEST` parts: the parser's time grows with the square of their number.

    Text with that many dots is rejected too; no valid file has it.
    """
    return any(len(_DOT_IN_KEY.findall(piece)) > DEEPEST for piece in _BETWEEN_KEYS.split(text))


def _is_deep(tree: object) -> bool:
    """Whether lists and tables nest deeper than `DEEPEST`; level by level, since the tree may be very deep.

    What stands in many places counts once: a name of YAML may stand for ten lists of ten names each, and so on.
    """
    level = {0: tree}
    for _ in range(DEEPEST):
        nodes = [node for node in level.values() if isinstance(node, (dict, list))]
        level = {id(part): part for node in nodes for part in _parts(node)}
        if not level:
            return False
    return True


def _parts(node: dict[str, Any] | list[Any]) -> list[Any]:
    return list(node.values()) if isinstance(node, dict) else node
