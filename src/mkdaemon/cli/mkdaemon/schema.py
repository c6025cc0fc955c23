"""`mkdaemon schema`: the message table for machines."""

from __future__ import annotations

import json
from typing import Annotated, Any

from cyclopts import Parameter

from mkdaemon.described import meanings_of
from mkdaemon.protocol.wire import MESSAGES, Board, Direction, WireMessage


def describe_message(board: Board, cls: type[WireMessage]) -> dict[str, Any]:
    """Return one row of the message table as plain data."""
    spec = cls.spec
    return {
        "board": board.word,
        "id": spec.id,
        "name": spec.name,
        "key": spec.key,
        "layout": spec.layout,
        "class": cls.__name__,
        "summary": (cls.__doc__ or "").strip().partition("\n")[0],
        "direction": "to_board" if spec.direction is Direction.TO_BOARD else "from_board",
        "size": spec.size,
        "reply": spec.reply,
        "firmware": spec.firmware,
        "danger": spec.danger.effect if spec.danger else "",
        "source": ", ".join(spec.sources),
        "fields": [
            {
                "name": slot.name,
                "firmware_word": slot.wire.mk,
                "type": slot.wire.type_name,
                "offset": slot.offset,
                "unit": slot.wire.unit,
                "scale": slot.wire.scale,
                "zero": slot.wire.zero,
                "si_unit": slot.wire.si,
                "meaning": meanings_of(cls)[slot.name],
                "values": {member.name: int(member) for member in slot.wire.enum} if slot.wire.enum else None,
            }
            for slot in spec.slots
        ],
    }


def schema(
    *,
    wire: Annotated[bool, Parameter(help="The message table: boards, ids, layouts, fields, offsets, units.")] = False,
) -> None:
    """Print the messages as JSON: the table with --wire, otherwise the JSON Schema of each message by class name.

    Example: mkdaemon schema --wire
    """
    if wire:
        content: Any = [describe_message(board, cls) for (board, _, _), cls in MESSAGES.items()]
    else:
        content = {cls.__name__: cls.model_json_schema() for cls in dict.fromkeys(MESSAGES.values())}
    print(json.dumps(content, indent=2))
