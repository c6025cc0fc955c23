"""Commands that are made from a table: a parameter for each field of a request."""

from __future__ import annotations

import inspect
from collections.abc import Awaitable, Callable, Iterable
from typing import Annotated, Any

from cyclopts import Parameter

from mkdaemon.cli.mkctl.connection import HERE, Connection

MadeCommand = Callable[..., Awaitable[None]]


def option(name: str, kind: Any, about: str, *, is_required: bool = False) -> inspect.Parameter:
    """An option; what is no flag may begin with a hyphen, as a negative number does.

    Args:
        name: of the field.
        kind: `bool` for a flag, which is False unless it is given; what is not required is None then.
        about: what it means.
        is_required: it must be given.
    """
    is_flag = kind is bool
    default: Any = inspect.Parameter.empty if is_required else False if is_flag else None
    given: Any = kind if is_required or is_flag else kind | None
    annotation = Annotated[given, Parameter(help=" ".join(about.split()), allow_leading_hyphen=not is_flag)]
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def make_command(
    work: Callable[[dict[str, Any], Connection], Awaitable[None]], options: Iterable[inspect.Parameter], doc: str
) -> MadeCommand:
    """A command as cyclopts reads one.

    Args:
        work: gets what was typed, by the names of the options, and the connection.
        options: every one but those of the connection.
        doc: its help.
    """

    async def run(**given: Any) -> None:
        await work(given, given.pop("connection", HERE))

    at = inspect.Parameter("connection", inspect.Parameter.KEYWORD_ONLY, default=HERE, annotation=Connection)
    parameters = [*options, at]
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    run.__doc__ = doc
    return run
