"""Schemas of what crosses the bus, as this version of mkdaemon knows them."""

from __future__ import annotations


def known_schema(name: str) -> bytes | None:
    """The JSON Schema of `<Name>.v<N>` as UTF-8 JSON; None where it is not known here.

    Args:
        name: as encodings name it, for example `Attitude.v1`.
    """
    from mkdaemon.bus.schema import schema_json

    return schema_json(name)
