"""What `mkctl` and `mkdaemon` share: lazily imported command tables, one-line errors, exit codes."""

from __future__ import annotations

import difflib
import gc
import importlib
import importlib.util
import os
import re
import signal
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Final, NoReturn

from cyclopts import (
    App,
    CycloptsError,
    Group,
    MissingArgumentError,
    Parameter,
    UnknownCommandError,
    UnusedCliTokensError,
    ValidationError,
)
from cyclopts.argument import Argument

from mkdaemon.cli.listing import CommandEntry, asks_for_list, list_lines, print_help
from mkdaemon.cli.renamed import new_name
from mkdaemon.cli.terminal import guarded_streams, print_whatever_the_encoding
from mkdaemon.errors import ConfigError, MkError

EXIT_OK: Final = 0
EXIT_FAILURE: Final = 1
EXIT_CONFIG: Final = 2
EXIT_WARNING: Final = 3
"""Of `mkdaemon doctor`: there are warnings, and no error."""
EXIT_INTERRUPTED: Final = 130
COMPLETION: Final = "--install-completion"
"""A command of every program that is not a row of its table."""
LONGEST_COMPLAINT: Final = 1000
"""Of a longer one the middle is left out [characters]: it quotes what a stranger wrote."""
_ENDS: Final = (signal.SIGTERM, signal.SIGHUP)
_OPTION: Final = re.compile(r"--?[A-Za-z]")


def build(name: str, about: str, table: Iterable[CommandEntry], *, chosen: str = "") -> App:
    """Make a program from its table. A command whose module is not installed is left out and breaks no other.

    Args:
        name: of the program.
        about: its own help.
        table: its commands.
        chosen: the command that is going to run.
    """
    app = App(
        name=name,
        help=about,
        version=_version,
        help_format="markdown",
        group_commands=Group("Subcommands"),
        default_parameter=Parameter(negative=()),  # no `--no-json` beside every `--json`
    )
    for entry in table:
        if importlib.util.find_spec(entry.target.partition(":")[0]) is not None:
            app.command(entry.target, name=entry.name)
    if chosen == COMPLETION:
        from mkdaemon.cli.completion import installer

        app.command(installer(app), name=COMPLETION)
    return app


def _version() -> str:
    from importlib.metadata import version  # 20 ms that only `--version` needs

    return version("mkdaemon")


def main(name: str, about: str, table: Iterable[CommandEntry], tokens: list[str] | None = None) -> NoReturn:
    """Run a program and end the process: 0 as asked, 1 failed while running, 2 wrong configuration or usage.

    Args:
        name: of the program.
        about: its own help.
        table: its commands.
        tokens: the command line; that of the process by default.
    """
    tokens = sys.argv[1:] if tokens is None else tokens
    table = tuple(table)
    if asks_for_list(tokens):
        print_help("\n".join(list_lines(name, about, table)))
        sys.exit(EXIT_OK)
    app = build(name, about, table, chosen=tokens[0] if tokens else "")
    _import_commands(table, tokens)
    print_whatever_the_encoding()
    ended_by: list[int] = []
    try:
        # `mkdaemon.cli.entry` has let an interrupt kill the process until here, where it can end in order. While
        # something is imported it cannot: the import machinery swallows a KeyboardInterrupt, and the program runs on.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        _end_like_an_interrupt(ended_by)
        code = run(app, tokens)
        _end_at_once()
    except KeyboardInterrupt:  # while a mistake was printed
        _end_at_once()
        code = EXIT_INTERRUPTED
    sys.exit(128 + ended_by[0] if ended_by and code == EXIT_INTERRUPTED else code)


def _import_commands(table: Iterable[CommandEntry], tokens: Sequence[str]) -> None:
    """Import the module of the command that is going to run.

    Nothing of it becomes garbage: the collector, which would look through it a hundred times, an eighth of the time
    that the daemon takes to be imported, does not see it.
    """
    gc.disable()
    for entry in table:
        if entry.name in tokens[:1]:
            # What is missing, or broken, is said when the command runs.
            with suppress(Exception):
                module, _, name = entry.target.partition(":")
                getattr(importlib.import_module(module), name)
    gc.freeze()
    gc.enable()


def let_signals_kill() -> None:
    """Let an interrupt and `kill` end the process at once, until the program's own handlers stand.

    For programs that run a loop: nothing is open yet that would have to be closed in order.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)


def _end_like_an_interrupt(came: list[int]) -> None:
    """Let a closed terminal and `kill` end a command in order too, as Ctrl-C does: motors stop, the live set is loaded.

    A program with its own handlers replaces these.

    Args:
        came: gets the signals that come.
    """

    def end(number: int, _: object) -> None:
        came.append(number)
        signal.raise_signal(signal.SIGINT)

    for number in _ENDS:
        if signal.getsignal(number) is not signal.SIG_IGN:  # nohup means it
            signal.signal(number, end)


def _end_at_once() -> None:
    """Let every signal end the process without a word again."""
    for number in (signal.SIGINT, *_ENDS):
        signal.signal(number, signal.SIG_DFL)


def run(app: App, tokens: Sequence[str] | None = None) -> int:
    """Run a program and return its exit code; every mistake is one line on stderr, and nothing acts on a terminal."""
    tokens = sys.argv[1:] if tokens is None else tokens
    with guarded_streams():
        return _run(app, tokens)


def _run(app: App, tokens: Sequence[str]) -> int:
    if (renamed := new_name(app.name[0], tokens)) is not None:
        return _complain(app, renamed, EXIT_CONFIG)
    if (mistake := _unknown_command(app, tokens)) is not None:
        return _complain(app, mistake, EXIT_CONFIG)

    def work() -> object:
        if tokens and {*tokens[1:]} <= {*app.help_flags}:
            _import_listed(app, tokens[0])
        return app(tokens, exit_on_error=False, print_error=False, result_action="return_value")

    return report_mistakes(app, tokens, work)


def _import_listed(app: App, name: str) -> None:
    """Import the commands of a group whose list is going to be shown, for the first line of their help."""
    if name in app and (group := app[name]).default_command is None:
        for one in group:
            group[one]


def report_mistakes(app: App, tokens: Sequence[str], work: Callable[[], object]) -> int:
    """Do what a command does and return its exit code; see `run`.

    Args:
        app: the program.
        tokens: its command line.
        work: the command.
    """
    try:
        result = work()
        sys.stdout.flush()
    except CycloptsError as error:
        command = " ".join((app.name[0], *(error.command_chain or ())))
        return _complain(app, _words_of(error, app, command, tokens), EXIT_CONFIG)
    except ConfigError as error:
        return _complain(app, error, EXIT_CONFIG)
    except MkError as error:
        return _complain(app, error, EXIT_FAILURE)
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except SystemExit as ended:
        return ended.code if isinstance(ended.code, int) else EXIT_OK
    except UnicodeEncodeError as error:
        return _complain(app, f"{error.object!a} is not text in this encoding: set LC_ALL=C.UTF-8", EXIT_CONFIG)
    except BrokenPipeError:
        _mute()
        return EXIT_OK  # the reader of our output has closed it
    except OSError as error:
        if error.errno is None:  # a wait of ours, not the system's
            return _complain(app, str(error) or "it took too long", EXIT_FAILURE)
        if error.filename is None:
            _mute()
        return _complain(app, f"{error.filename or 'standard output'}: {error.strerror or error}", EXIT_FAILURE)
    return result if isinstance(result, int) else EXIT_OK


def _words_of(error: CycloptsError, app: App, command: str, tokens: Sequence[str]) -> str:
    """What is wrong with a command line, in a sentence or two."""
    if isinstance(error, ValidationError) and error.argument is not None and error.argument.tokens:
        return f"{error.argument.name} {error.argument.tokens[0].value}: {error.exception_message}"
    return f"{_misuse(error, app, command, tokens)} See `{command} --help`."


def _misuse(error: CycloptsError, app: App, command: str, tokens: Sequence[str]) -> str:
    match error:
        case MissingArgumentError() if (mistake := _unknown_option(error, app)) is not None:
            return mistake  # reported before the argument that is missing because of it
        case MissingArgumentError(argument=Argument() as missing):
            name = missing.name if missing.index is None else missing.name.lstrip("-").upper()
            return f"{name} needs a value." if missing.name in tokens else f"`{command}` needs {name}."
        case UnknownCommandError(unused_tokens=[str() as first, *_], app=App() as group) if first.startswith("-"):
            names = [name for name in group if not name.startswith("-")]
            words = " or ".join(part for part in (", ".join(names[:-1]), names[-1]) if part)
            return f"`{command}` needs {words} before {first}."
        case UnusedCliTokensError():
            return f"`{command}` does not take {' '.join(error.unused_tokens or ())!r}."
    return str(error)


def _unknown_option(error: CycloptsError, app: App) -> str | None:
    """What is wrong with an option that the command does not have; None if there is none."""
    for name in error.command_chain or ():
        app = app[name]
    known = [name for argument in app.assemble_argument_collection() for name in argument.names]
    given = (word.partition("=")[0] for word in error.unused_tokens or () if _OPTION.match(word))
    unknown = next((name for name in given if name not in known), None)
    if unknown is None:
        return None
    near = difflib.get_close_matches(unknown, known, n=1)
    return f"Unknown option: {unknown}.{f' Did you mean {near[0]}?' if near else ''}"


def _unknown_command(app: App, tokens: Sequence[str]) -> str | None:
    """What is wrong with the first word, said without importing every command as cyclopts would; None if nothing is."""
    names = [name for name in app if name not in {*app.help_flags, *app.version_flags}]
    if not tokens or not names or app.default_command is not None or tokens[0] in app:
        return None
    if tokens[0].startswith("-"):
        return f'Unknown option "{tokens[0]}". See `{app.name[0]} --help`.'
    if tokens[0] in {"help", "version"}:
        return f'Unknown command "{tokens[0]}". Did you mean `{app.name[0]} --{tokens[0]}`?'
    near = difflib.get_close_matches(tokens[0], names, n=1)
    hint = f'Did you mean "{near[0]}"?' if near else f"There is {', '.join(names)}."
    return f'Unknown command "{tokens[0]}". {hint} See `{app.name[0]} --help`.'


def _mute() -> None:
    """Send what is still buffered for standard output nowhere, or the interpreter fails once more when it flushes."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _complain(app: App, error: MkError | str, code: int) -> int:
    text = " ".join(str(error).split())
    if len(text) > LONGEST_COMPLAINT:
        text = f"{text[: LONGEST_COMPLAINT // 2]} ... {text[-LONGEST_COMPLAINT // 2 :]}"
    print(f"{app.name[0]}: {text}", file=sys.stderr)
    return code
