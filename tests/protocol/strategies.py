"""Random messages, drawn from the limits their fields declare."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import pairwise

from hypothesis import strategies as st

from mkdaemon.protocol.fields import WireField
from mkdaemon.protocol.wire import MESSAGES, WireMessage

CLASSES: Sequence[type[WireMessage]] = tuple(dict.fromkeys(MESSAGES.values()))


def class_name(cls: type[WireMessage]) -> str:
    return cls.__name__


def numbers(wire: WireField) -> st.SearchStrategy[int]:
    if wire.only:
        return st.sampled_from(sorted(wire.only))
    edges = st.sampled_from([wire.minimum, wire.maximum])
    return edges | st.integers(wire.minimum, wire.maximum)


def values(wire: WireField) -> st.SearchStrategy[object]:
    if wire.is_bytes:
        # A message of variable length arrives padded: a whole number of groups of three survives as it is.
        sizes = range(wire.count, (wire.longest or wire.count) + 1)
        return st.sampled_from(sizes).flatmap(lambda size: st.binary(min_size=size, max_size=size))
    if wire.is_text:
        letters = st.characters(min_codepoint=0x21, max_codepoint=0xFF)
        return st.text(letters, max_size=wire.count).map(lambda text: text if wire.trim else text.ljust(wire.count))
    if wire.is_array:
        return st.lists(numbers(wire), min_size=wire.count, max_size=wire.count).map(tuple)
    return numbers(wire)


@cache
def messages(cls: type[WireMessage]) -> st.SearchStrategy[WireMessage]:
    return st.fixed_dictionaries({slot.name: values(slot.wire) for slot in cls.spec.slots}).map(
        lambda fields: cls(**fields)
    )


def split(data: bytes, cuts: Sequence[int]) -> list[bytes]:
    """`data` cut at the given places."""
    places = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    return [data[start:stop] for start, stop in pairwise(places)]
