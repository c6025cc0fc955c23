"""KMZ: a KML document in a ZIP file. Source: OGC 07-147r2, KML 2.2, annex C."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path

from mkdaemon.missions.source import Place
from mkdaemon.reading import open_regular


def read_kmz(path: Path, limit: int) -> str:
    """The text of the document in a KMZ file: the first `.kml` of its outermost folder.

    Args:
        path: the file.
        limit: longest file, and longest document [bytes].

    Raises:
        OSError: the file cannot be opened, or is too long.
        UnicodeDecodeError: the document is no UTF-8 text.
        ConfigError: it is no ZIP file, holds no document, or one that is too long, encrypted or damaged.
    """
    place = Place(str(path), 1)
    again = "save it again as .kml"
    try:
        with open_regular(path, limit) as file, zipfile.ZipFile(file) as packed:
            documents = [one for one in packed.infolist() if one.filename.lower().endswith(".kml")]
            documents.sort(key=lambda one: "/" in one.filename)
            if not documents:
                raise place.wrong("no KML document in this file", again)
            with packed.open(documents[0]) as document:
                content = document.read(limit + 1)
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError, ValueError) as error:
        raise place.wrong(f"no KMZ file that can be read ({error})", again) from error
    if len(content) > limit:
        raise place.wrong(f"its document is larger than {limit / 1e6:g} MB", "export a shorter route")
    return content.decode("utf-8-sig")
