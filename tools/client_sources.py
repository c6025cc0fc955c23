"""Three sources of `mkdaemon.client`, made from the tables of keys, verbs and setpoints.

They are committed, so that mypy and editors see every type; a new key or verb needs `python -m tools.docs` and nothing
else in the client.
"""

from __future__ import annotations

import re
import subprocess
import sys
import textwrap
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Any, Final

from pydantic import BaseModel

from mkdaemon.bus.keys import KEYS, KeySpec, Use
from mkdaemon.described import meanings_of
from mkdaemon.telemetry.setpoint import SETPOINTS, Setpoint
from mkdaemon.telemetry.verbs import VERBS, Verb

_Item = typing.TypeVar("_Item")
_WIDTH: Final = 120
_FILLED_IN: Final = frozenset({"holder", "epoch", "sequence", "ttl", "after_abort"})
"""Fields that the client fills in itself, or that every setpoint has."""
TTL: Final = 0.3
"""Time a setpoint holds [s]; the daemon's own limit, `control.limiter.setpoint_ttl`, is the same."""
_CONNECTS: Final = (
    "    def __init__(self, session: zenoh.Session, vehicle: str, endpoint: str) -> None:",
    "        super().__init__(session, vehicle, endpoint)",
)


def _source(about: str, table: str, imports: Sequence[str], models: Iterable[type], body: Iterable[str]) -> str:
    """A module as ruff writes it, which orders the imports and leaves out those that nothing needs."""
    lines = [
        *(f'"""{about}\n', f'Made by `python -m tools.docs` from {table}; do not edit.\n"""\n'),
        *("from __future__ import annotations", "from collections.abc import Callable, Mapping, Sequence"),
        *("from typing import TYPE_CHECKING, Any, Literal", *imports, "if TYPE_CHECKING:"),
        *(f"    from {model.__module__} import {model.__name__}" for model in models),
        *body,
    ]
    text = "\n".join(lines) + "\n"
    for words in ("check --fix --quiet --select I,F401", "format --quiet"):
        options = [*words.split(), f"--line-length={_WIDTH}", "--stdin-filename=src/a.py", "-"]
        command = [sys.executable, "-m", "ruff", *options]
        text = subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout
    return text


def key_tree(_root: Path | None = None) -> str:
    """The source of `mkdaemon.client.keytree`: a stream for every key that carries values."""
    specs = [spec for spec in KEYS if spec.use in {Use.PUBLISHED, Use.CLIENT} and spec.carries is not None]
    return _source(
        "The values of every key, typed: `uav.state.attitude()`, `uav.vision(camera).pose()`.",
        "bus/keys.py",
        (
            "import zenoh",
            "from mkdaemon.client.streams import Stream, part_of_key",
            "from mkdaemon.client.transport import Transport",
        ),
        [spec.carries for spec in specs if spec.carries],
        _key_class((), specs),
    )


def verb_calls(_root: Path | None = None) -> str:
    """The source of `mkdaemon.client.verbcalls`: a method for every verb, a class for every service."""
    verbs = [verb for verb in VERBS if verb.has_method]
    services = _grouped(verbs, lambda verb: verb.service)
    body: list[str] = []
    for service, own in services.items():
        if service:
            body += [f"class {_camel(service)}Verbs(Asking):", f'    """Verbs of `uav.{service}`."""']
            body += [line for verb in own for line in _verb(verb)]
    body += [
        "class VerbCalls(KeyTree):",
        '    """Every verb as a method, of the vehicle or of a service."""',
        *_CONNECTS,
    ]
    body += ["        self._asking = Asking(self)"]
    body += [f"        self.{name} = {_camel(name)}Verbs(self)" for name in services if name]
    body += [line for verb in services[""] for line in _verb(verb)]
    return _source(
        "Every verb of the daemon as a method with its types.",
        "telemetry/verbs.py",
        (
            "import zenoh",
            "from mkdaemon.client.asking import Asking, OnProgress",
            "from mkdaemon.client.keytree import KeyTree",
        ),
        [model for verb in verbs for model in (*_models_of(verb.request), *([verb.reply] if verb.reply else []))],
        body,
    )


def setpoint_calls(_root: Path | None = None) -> str:
    """The source of `mkdaemon.client.setpointcalls`: a method for every kind of setpoint."""
    body = [
        *("class SetpointCalls:", '    """One setpoint of each kind: `lease.set.velocity(...)`."""'),
        "    def __init__(self, put: Callable[[str, Mapping[str, Any], float], None]) -> None:",
        "        self._put = put",
        *(line for model in SETPOINTS for line in _setpoint(model)),
    ]
    models = [kind for model in SETPOINTS for kind in _models_of(model)]
    return _source("Every kind of setpoint as a method with its types.", "telemetry/setpoint.py", (), models, body)


def _grouped(items: Iterable[_Item], key: Callable[[_Item], str]) -> dict[str, list[_Item]]:
    """Items by a key, both in their first order."""
    found: dict[str, list[_Item]] = {}
    for item in items:
        found.setdefault(key(item), []).append(item)
    return found


def _camel(name: str) -> str:
    return "".join(part.capitalize() for part in name.split("_"))


# -- keys -----------------------------------------------------------------------------------------------------------

_Path = tuple[str, ...]
"""Chunks of a key; `<name>` is a variable."""


def _key_class(path: _Path, specs: Sequence[KeySpec]) -> Iterator[str]:
    """The class of the keys that begin so, after those of what it holds."""
    ends: dict[str, tuple[_Path, list[KeySpec]]] = {}
    for chunk, own in _grouped(specs, lambda spec: _chunks(spec)[len(path)]).items():
        end = (*path, chunk)
        while len(after := {_chunks(spec)[len(end)] for spec in own if len(_chunks(spec)) > len(end)}) == 1:
            if not next(iter(after)).startswith("<"):
                break
            end += tuple(after)  # every name that must follow is given at once
        ends[chunk] = end, own
        if after:
            yield from _key_class(end, [spec for spec in own if len(_chunks(spec)) > len(end)])
    names = _names(path)
    members = [(chunk, end, _names(end)[len(names) :], own) for chunk, (end, own) in ends.items()]
    if path:
        arguments = ["self", "transport: Transport", *(f"{name}: str" for name in names)]
        yield from (f"class {_class_name(path)}:", f'    """Streams of `{"/".join(path)}/...`."""')
        yield f"    def __init__({', '.join(arguments)}) -> None:"
        if any(new for _, _, new, _ in members):
            yield "        self._transport = transport"
    else:
        yield from (
            "class KeyTree(Transport):",
            '    """Every key that carries values, as typed streams."""',
            *_CONNECTS,
        )
    for chunk, end, new, own in members:
        if not new:
            kind, value = _member(end, own, "transport" if path else "self")
            yield from (f"        self.{chunk}: {kind} = {value}", *_text(end, own))
    for chunk, end, new, own in members:
        if new:
            kind, value = _member(end, own, "self._transport" if path else "self")
            yield f"    def {chunk}(self, {', '.join(f'{name}: str' for name in new)}) -> {kind}:"
            yield from (*_text(end, own), f"        return {value}")


def _chunks(spec: KeySpec) -> _Path:
    return tuple(spec.suffix.split("/"))


def _names(path: _Path) -> list[str]:
    return [chunk[1:-1] for chunk in path if chunk.startswith("<")]


def _class_name(path: _Path) -> str:
    return f"{''.join(_camel(chunk.strip('<>')) for chunk in path)}Keys"


def _member(end: _Path, specs: Sequence[KeySpec], transport: str) -> tuple[str, str]:
    """Type and value of what stands for a key, or for those that begin so; names in it are variables."""
    spec = next((spec for spec in specs if _chunks(spec) == end), None)
    if spec is None or spec.carries is None:
        return _class_name(end), f"{_class_name(end)}({', '.join([transport, *_names(end)])})"
    model = spec.carries
    module = model.__module__.rpartition(".")[2]
    key = re.sub(r"<(\w+)>", r"{part_of_key(\1)}", spec.suffix)
    prefix = "f" if _names(end) else ""
    return f"Stream[{model.__name__}]", f'Stream({transport}, {prefix}"{key}", "{module}:{model.__name__}")'


def _text(end: _Path, specs: Sequence[KeySpec]) -> list[str]:
    """A docstring of one paragraph."""
    spec = next((spec for spec in specs if _chunks(spec) == end), None)
    words = f"`{spec.suffix}`, {spec.when}: {spec.about}" if spec else f"Streams of `{'/'.join(end)}/...`."
    lines = _wrapped(f'"""{words}', 8, width=_WIDTH - 3)
    return [*lines[:-1], f'{lines[-1]}"""']


# -- methods --------------------------------------------------------------------------------------------------------


def _setpoint(model: type[Setpoint]) -> Iterator[str]:
    kind = model.suffix.removeprefix("setpoint/")
    fields = [name for name in model.model_fields if name not in _FILLED_IN]
    arguments = ["self", "*", *(_argument(model, name) for name in fields), f"ttl: float = {TTL}"]
    method = re.sub(r"(?<!^)(?=[A-Z])", "_", model.__name__.removesuffix("Setpoint")).lower()
    yield f"    def {method}({', '.join(arguments)}) -> None:"
    yield from _docstring(
        model,
        f"setpoint/{kind}",
        fields,
        {"ttl": "Age at which it no longer holds [s]."},
        "LeaseLostError: the lease has ended; the text says why.",
        "CommandRejectedError: `bad_field`: a number is out of range.",
    )
    yield f'        self._put("{kind}", {_map(fields)}, ttl)'


def _verb(verb: Verb) -> Iterator[str]:
    """The method of a verb: its request's fields as arguments, its reply as the result."""
    fields = {name: info for name, info in verb.request.model_fields.items() if name not in _FILLED_IN}
    required = [name for name, info in fields.items() if info.is_required()]
    plain = [name for name in fields if name != "confirm" and fields[name].annotation is not bool]
    positional = [*required, *(name for name in plain if name not in required and len(fields) <= 2)]
    keyword = [name for name in fields if name not in positional]
    arguments = ["self", *(_argument(verb.request, name) for name in positional)]
    if keyword or verb.is_procedure:
        arguments += ["*", *(_argument(verb.request, name) for name in keyword)]
    if verb.is_procedure:
        arguments.append("on_progress: OnProgress | None = None")
    reply = verb.reply.__name__ if verb.reply else "None"
    yield f"    async def {verb.method}({', '.join(arguments)}) -> {reply}:"
    yield from _docstring(
        verb.request,
        f"do/{verb.name}",
        [*positional, *keyword],
        {"on_progress": "called with every step."} if verb.is_procedure else {},
        "MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon.",
    )
    helper = "self" if verb.service else "self._asking"
    if verb.reply is None:
        holder = ", with_holder=True" if "holder" in verb.request.model_fields else ""
        yield f'        await {helper}.order("{verb.name}", {_map(fields)}, {verb.patience:g}{holder})'
        return
    given = f'"{verb.name}", "{verb.reply.__module__.rpartition(".")[2]}:{reply}", {_map(fields)}'
    call = f"run({given}, on_progress)" if verb.is_procedure else f"ask({given}, {verb.patience:g})"
    yield f"        return await {helper}.{call}"


def _map(names: Iterable[str]) -> str:
    return f"{{{', '.join(f'{chr(34)}{name}{chr(34)}: {name}' for name in names)}}}"


def _argument(model: type[BaseModel], name: str) -> str:
    info = model.model_fields[name]
    text = f"{name}: {_spell(info.annotation)}"
    return text if info.is_required() else f"{text} = {info.default!r}"


def _docstring(
    model: type[BaseModel], key: str, names: Iterable[str], more: Mapping[str, str], *raised: str
) -> Iterator[str]:
    """What the class of a request or setpoint says, its fields and further arguments, and what is refused."""
    text = " ".join((model.__doc__ or "").split()).replace(f": `{key}`", "")
    first, _, rest = text.partition(". ")
    yield from (*_wrapped(f'"""{first.rstrip(".")}.', 8), "")
    if rest:
        yield from (*_wrapped(rest, 8), "")
    meanings = meanings_of(model)
    if arguments := {name: " ".join(meanings[name].replace("null", "None").split()) for name in names} | dict(more):
        yield "        Args:"
        for name, words in arguments.items():
            yield from _wrapped(f"{name}: {words}", 12, hanging=4)
        yield ""
    yield from ("        Raises:", *(f"            {words}" for words in raised), '        """')


def _wrapped(text: str, indent: int, *, hanging: int = 0, width: int = _WIDTH) -> list[str]:
    first, later = " " * indent, " " * (indent + hanging)
    return textwrap.wrap(text, width, initial_indent=first, subsequent_indent=later, break_on_hyphens=False)


def _models_of(model: type[BaseModel]) -> Iterator[type]:
    for name, info in model.model_fields.items():
        if name not in _FILLED_IN:
            yield from models_in(info.annotation)


def models_in(annotation: Any) -> Iterator[type[BaseModel | Enum]]:
    """Return the models and enumerations in a type."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel | Enum):
        yield annotation
    for part in typing.get_args(annotation):
        yield from models_in(part)


def _spell(annotation: Any) -> str:
    """A type as it is written; what the caller gives may be any sequence or mapping."""
    origin, parts = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        return _spell(parts[0])
    if origin in {typing.Union, types.UnionType}:
        return " | ".join(_spell(part) for part in parts)
    if origin is typing.Literal:
        return f"Literal[{', '.join(map(repr, parts))}]"
    if origin is tuple and parts[-1] is Ellipsis:
        return f"Sequence[{_spell(parts[0])}]"
    if origin is dict:
        return f"Mapping[{', '.join(map(_spell, parts))}]"
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return f"{annotation.__name__} | Literal[{', '.join(repr(member.value) for member in annotation)}]"
    if origin is not None:
        return f"{origin.__name__}[{', '.join(map(_spell, parts))}]"
    return "None" if annotation is type(None) else str(annotation.__name__)
