"""KMZ: a KML document in a ZIP file. Source: OGC 07-147r2, KML 2.2, annex C."""

from __future__ import annotations

import lzma
import struct
import zipfile
import zlib
from pathlib import Path
from typing import BinaryIO, Final

from mkdaemon.foreignfiles import open_regular
from mkdaemon.missions.source import FilePlace

_DAMAGED: Final = (zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, RuntimeError, EOFError, ValueError)
"""What reading a ZIP file raises; a method of compression that is not known is a RuntimeError, too."""


def read_kmz(path: Path, limit: int) -> tuple[str, list[str]]:
    """The text of the document in a KMZ file, the first `.kml` of its outermost folder; and the names of the others.

    Args:
        path: the file.
        limit: longest file, and longest document [bytes].

    Raises:
        OSError: the file cannot be opened, or is too long.
        UnicodeDecodeError: the document is not UTF-8 text.
        ConfigError: it is not a ZIP file, holds no document, or one that is too long, encrypted or damaged.
    """
    place = FilePlace(str(path), 1)
    again = "save it again as .kml"
    with open_regular(path, limit) as file:
        try:
            content, others = _documents(file, limit)
        except (*_DAMAGED, OSError) as error:  # bz2 has OSError for its own
            raise place.wrong(f"no KMZ file that can be read ({error})", again) from error
    if content is None:
        raise place.wrong("no KML document in this file", again)
    if len(content) > limit:
        raise place.wrong(f"its document is larger than {limit / 1e6:g} MB", "export a shorter route")
    return content.decode("utf-8-sig"), others


def _documents(file: BinaryIO, limit: int) -> tuple[bytes | None, list[str]]:
    """The first document, as far as its limit, or None; and the names of the others."""
    with zipfile.ZipFile(file) as packed:
        documents = [one for one in packed.infolist() if one.filename.lower().endswith(".kml")]
        documents.sort(key=lambda one: "/" in one.filename)
        others = [one.filename for one in documents[1:]]
        if not documents:
            return None, others
        with packed.open(documents[0]) as document:
            return document.read(limit + 1), others
