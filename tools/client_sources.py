"""Two sources of `mkdaemon.client`, made from the table of keys and the table of verbs.

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
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any, Final

from pydantic import BaseModel

from mkdaemon.bus.keys import KEYS, KeySpec, Use
from mkdaemon.described import meanings_of
from mkdaemon.telemetry.setpoint import SETPOINTS, Setpoint
from mkdaemon.telemetry.verbs import VERBS, Verb

_MADE: Final = "Made by `python -m tools.docs` from {table}; do not edit."
_WIDTH: Final = 120
_FILLED_IN: Final = frozenset({"holder", "epoch", "sequence", "ttl", "after_abort"})
"""Fields that the client fills in itself, or that every setpoint has."""
TTL: Final = 0.3
"""Time a setpoint holds [s]; the daemon's own limit, `control.limiter.setpoint_ttl`, is the same."""


def key_tree(_root: Path | None = None) -> str:
    """The source of `mkdaemon.client.keytree`: a stream for every key that carries values."""
    shown = [spec for spec in KEYS if spec.use in {Use.PUBLISHED, Use.CLIENT} and spec.carries is not None]
    models = {(spec.carries.__module__, spec.carries.__name__) for spec in shown if spec.carries}
    head = [
        *_head("The values of every key, typed: `uav.state.attitude()`, `uav.vision(camera).pose()`.", "bus/keys.py"),
        "from typing import TYPE_CHECKING",
        "",
        "import zenoh",
        "",
        "from mkdaemon.client.streams import Stream, part_of_key",
        "from mkdaemon.client.transport import Transport",
        "",
        "if TYPE_CHECKING:",
        *(f"    from {module} import {name}" for module, name in sorted(models)),
    ]
    return _formatted([*head, *_key_classes(_node_of(shown))])


def verb_calls(_root: Path | None = None) -> str:
    """The source of `mkdaemon.client.verbcalls`: a method for every verb, a class for every service."""
    services: dict[str, list[Verb]] = defaultdict(list)
    for verb in VERBS:
        if verb.has_method:
            services[verb.service].append(verb)
    body: list[str] = []
    for service, verbs in services.items():
        if service:
            about = f"Verbs of `uav.{service}`."
            body += ["", "", f"class {_camel(service)}Verbs(Asking):", f'    """{about}"""']
            body += [line for verb in verbs for line in _method(verb)]
    body += [
        "",
        "",
        "class VerbCalls(KeyTree):",
        '    """Every verb as a method, of the vehicle or of a service."""',
        "",
    ]
    body += ["    def __init__(self, session: zenoh.Session, vehicle: str, endpoint: str) -> None:"]
    body += ["        super().__init__(session, vehicle, endpoint)", "        self._asking = Asking(self)"]
    body += [f"        self.{name} = {_camel(name)}Verbs(self)" for name in services if name]
    body += [line for verb in services[""] for line in _method(verb)]
    models = sorted(
        {
            (model.__module__, model.__name__)
            for verb in VERBS
            if verb.has_method
            for model in (*_models_of(verb.request), *([verb.reply] if verb.reply else []))
        }
    )
    head = [
        *_head("Every verb of the daemon as a method with its types.", "telemetry/verbs.py"),
        "from collections.abc import Mapping, Sequence",
        "from typing import TYPE_CHECKING, Literal",
        "",
        "import zenoh",
        "",
        "from mkdaemon.client.asking import Asking, OnProgress",
        "from mkdaemon.client.keytree import KeyTree",
        "",
        "if TYPE_CHECKING:",
        *(f"    from {module} import {name}" for module, name in models),
    ]
    return _formatted([*head, *body])


def setpoint_calls(_root: Path | None = None) -> str:
    """The source of `mkdaemon.client.setpointcalls`: a method for every kind of setpoint."""
    body = ["", "", "class SetpointCalls:", '    """One setpoint of each kind: `lease.set.velocity(...)`."""', ""]
    body += ["    def __init__(self, put: Callable[[str, Mapping[str, Any], float], None]) -> None:"]
    body += ["        self._put = put"]
    for model in SETPOINTS:
        body += _setpoint(model)
    models = sorted({(kind.__module__, kind.__name__) for model in SETPOINTS for kind in _models_of(model)})
    head = [
        *_head("Every kind of setpoint as a method with its types.", "telemetry/setpoint.py"),
        "from collections.abc import Callable, Mapping, Sequence",
        "from typing import TYPE_CHECKING, Any, Literal",
        "",
        "if TYPE_CHECKING:",
        *(f"    from {module} import {name}" for module, name in models),
    ]
    return _formatted([*head, *body])


def _setpoint(model: type[Setpoint]) -> Iterator[str]:
    kind = model.suffix.removeprefix("setpoint/")
    fields = [name for name in model.model_fields if name not in _FILLED_IN]
    arguments = ["self", "*", *(_argument(model, name) for name in fields), f"ttl: float = {TTL}"]
    method = re.sub(r"(?<!^)(?=[A-Z])", "_", model.__name__.removesuffix("Setpoint")).lower()
    yield from ("", f"    def {method}({', '.join(arguments)}) -> None:")
    text = " ".join((model.__doc__ or "").split()).replace(f": `setpoint/{kind}`", "")
    yield from _summary(text)
    yield "        Args:"
    meanings = meanings_of(model)
    for name in fields:
        yield from _wrapped(f"{name}: {_plain_words(meanings[name])}", 12, hanging=4)
    yield "            ttl: Age at which it no longer holds [s]."
    yield from ("", "        Raises:", "            LeaseLostError: the lease has ended; the text says why.")
    yield from ("            CommandRejectedError: `bad_field`: a number is out of range.", '        """')
    yield f'        self._put("{kind}", {{{", ".join(f"{chr(34)}{name}{chr(34)}: {name}" for name in fields)}}}, ttl)'


def _head(about: str, table: str) -> list[str]:
    return [f'"""{about}', "", _MADE.format(table=table), '"""', "", "from __future__ import annotations", ""]


def _formatted(lines: Iterable[str]) -> str:
    """The lines as ruff writes them."""
    command = [sys.executable, "-m", "ruff"]
    text = "\n".join(lines) + "\n"
    for words in (["check", "--fix", "--quiet", "--select", "I,F401"], ["format", "--quiet"]):
        done = subprocess.run(
            [*command, *words, "--line-length", str(_WIDTH), "--stdin-filename", "src/made.py", "-"],
            input=text,
            capture_output=True,
            text=True,
            check=True,
        )
        text = done.stdout
    return text


def _camel(name: str) -> str:
    return "".join(part.capitalize() for part in name.split("_"))


# -- keys -----------------------------------------------------------------------------------------------------------


@dataclass
class _Node:
    """A chunk of keys.

    Attributes:
        path: the chunks before.
        spec: the key that ends here.
        children: by their chunk.
    """

    path: tuple[str, ...] = ()
    spec: KeySpec | None = None
    children: dict[str, _Node] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        """The variable chunks of the path."""
        return [chunk[1:-1] for chunk in self.path if chunk.startswith("<")]

    @property
    def class_name(self) -> str:
        """Of the class of its members; the root's is the tree."""
        return f"{''.join(_camel(chunk.strip('<>')) for chunk in self.path)}Keys" if self.path else "KeyTree"

    def behind_names(self) -> _Node:
        """The node that is reached when every name that must follow is given."""
        if len(self.children) == 1 and (chunk := next(iter(self.children))).startswith("<"):
            return self.children[chunk].behind_names()
        return self


def _node_of(specs: Iterable[KeySpec]) -> _Node:
    root = _Node()
    for spec in specs:
        node = root
        for chunk in spec.suffix.split("/"):
            node = node.children.setdefault(chunk, _Node((*node.path, chunk)))
        node.spec = spec
    return root


def _key_classes(node: _Node) -> Iterator[str]:
    """The class of a node, after those of what it holds."""
    ends = {name: child.behind_names() for name, child in node.children.items()}
    for end in ends.values():
        if end.children:
            yield from _key_classes(end)
    is_root = not node.path
    transport = "self" if is_root else "self._transport"
    yield from ("", "", f"class {node.class_name}{'(Transport)' if is_root else ''}:")
    about = (
        "Every key that carries values, as typed streams." if is_root else f"Streams of `{'/'.join(node.path)}/...`."
    )
    yield from (f'    """{about}"""', "")
    if is_root:
        yield "    def __init__(self, session: zenoh.Session, vehicle: str, endpoint: str) -> None:"
        yield "        super().__init__(session, vehicle, endpoint)"
    else:
        arguments = ["self", "transport: Transport", *(f"{name}: str" for name in node.names)]
        yield f"    def __init__({', '.join(arguments)}) -> None:"
    known = len(node.names)
    if not is_root and any(len(end.names) > known for end in ends.values()):
        yield "        self._transport = transport"
    for name, end in ends.items():
        if len(end.names) == known:
            kind, value = _member(end, "self" if is_root else "transport")
            yield from (f"        self.{name}: {kind} = {value}", *_text(_words(end), 8))
    for name, end in ends.items():
        if new := end.names[known:]:
            kind, value = _member(end, transport)
            yield from ("", f"    def {name}(self, {', '.join(f'{one}: str' for one in new)}) -> {kind}:")
            yield from (*_text(_words(end), 8), f"        return {value}")


def _member(node: _Node, transport: str) -> tuple[str, str]:
    """Type and value of what stands for a node; names in its key are variables."""
    if node.spec is None or node.spec.carries is None:
        return node.class_name, f"{node.class_name}({', '.join([transport, *node.names])})"
    model = node.spec.carries
    module = model.__module__.rpartition(".")[2]
    key = re.sub(r"<(\w+)>", r"{part_of_key(\1)}", node.spec.suffix)
    return (
        f"Stream[{model.__name__}]",
        f'Stream({transport}, {"f" if node.names else ""}"{key}", "{module}:{model.__name__}")',
    )


def _words(node: _Node) -> str:
    spec = node.spec
    return f"Streams of `{'/'.join(node.path)}/...`." if spec is None else f"`{spec.suffix}`, {spec.when}: {spec.about}"


def _text(words: str, indent: int) -> list[str]:
    """A docstring of one paragraph."""
    space = " " * indent
    lines = textwrap.wrap(f'"""{words}', _WIDTH - indent - 3, break_on_hyphens=False)
    return [*(space + line for line in lines[:-1]), f'{space}{lines[-1]}"""']


# -- verbs ----------------------------------------------------------------------------------------------------------


def _method(verb: Verb) -> Iterator[str]:
    """The method of a verb: its request's fields as arguments, its reply as the result."""
    fields = {name: info for name, info in verb.request.model_fields.items() if name not in _FILLED_IN}
    required = [name for name, info in fields.items() if info.is_required()]
    optional = [name for name in fields if name not in required]
    plain = [name for name in optional if name != "confirm" and not _is_flag(fields[name].annotation)]
    positional = [*required, *(plain if len(fields) <= 2 else [])]
    keyword = [name for name in fields if name not in positional]
    yield ""
    arguments = ["self", *(_argument(verb.request, name) for name in positional)]
    if keyword or verb.is_procedure:
        arguments += ["*", *(_argument(verb.request, name) for name in keyword)]
    if verb.is_procedure:
        arguments.append("on_progress: OnProgress | None = None")
    reply = verb.reply.__name__ if verb.reply else "None"
    yield f"    async def {verb.method}({', '.join(arguments)}) -> {reply}:"
    yield from _docstring(verb, [*positional, *keyword])
    asked = f"{{{', '.join(f'{chr(34)}{name}{chr(34)}: {name}' for name in fields)}}}"
    helper = "self" if verb.service else "self._asking"
    if verb.reply is None:
        holder = ", with_holder=True" if "holder" in verb.request.model_fields else ""
        yield f'        await {helper}.order("{verb.name}", {asked}, {verb.patience:g}{holder})'
        return
    given = f'"{verb.name}", "{verb.reply.__module__.rpartition(".")[2]}:{reply}", {asked}'
    if verb.is_procedure:
        yield f"        return await {helper}.run({given}, on_progress)"
    else:
        yield f"        return await {helper}.ask({given}, {verb.patience:g})"


def _argument(model: type[BaseModel], name: str) -> str:
    info = model.model_fields[name]
    text = f"{name}: {_spell(info.annotation)}"
    return text if info.is_required() else f"{text} = {info.default!r}"


def _is_flag(annotation: Any) -> bool:
    return annotation is bool


def _docstring(verb: Verb, names: list[str]) -> Iterator[str]:
    """What the request's class says, its fields, and what is refused."""
    text = " ".join((verb.request.__doc__ or "").split()).replace(f": `do/{verb.name}`", "")
    yield from _summary(text)
    meanings = meanings_of(verb.request)
    if names or verb.is_procedure:
        yield "        Args:"
        for name in names:
            yield from _wrapped(f"{name}: {_plain_words(meanings[name])}", 12, hanging=4)
        if verb.is_procedure:
            yield "            on_progress: called with every step."
        yield ""
    yield "        Raises:"
    yield "            MkError: refused or failed (`CommandRejectedError`: token, reason, fix), or there is no daemon."
    yield '        """'


def _summary(text: str) -> Iterator[str]:
    """The beginning of a docstring: the first sentence, then the others."""
    first, _, rest = text.partition(". ")
    yield from _wrapped(f'"""{first.rstrip(".")}.', 8)
    if rest:
        yield from ("", *_wrapped(rest, 8))
    yield ""


def _plain_words(text: str) -> str:
    return " ".join(text.replace("null", "None").split())


def _wrapped(text: str, indent: int, *, hanging: int = 0) -> list[str]:
    return textwrap.wrap(
        text,
        _WIDTH,
        initial_indent=" " * indent,
        subsequent_indent=" " * (indent + hanging),
        break_on_hyphens=False,
    )


def _models_of(model: type[BaseModel]) -> Iterator[type]:
    for name, info in model.model_fields.items():
        if name not in _FILLED_IN:
            yield from _models_in(info.annotation)


def _models_in(annotation: Any) -> Iterator[type]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel | Enum):
        yield annotation
    for part in typing.get_args(annotation):
        yield from _models_in(part)


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
