"""`mkdaemon config`: check, show, explain and begin the file of an aircraft."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Final

from cyclopts import App, Parameter

from mkdaemon.cli import printing
from mkdaemon.cli.arguments import AsJson
from mkdaemon.cli.mkdaemon.documentedfiles import documented_files
from mkdaemon.cli.mkdaemon.extraprograms import file_with
from mkdaemon.cli.mkdaemon.runoptions import NONE_GIVEN, RunOptions, load_configuration
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_OK
from mkdaemon.cli.terminal import on_one_line
from mkdaemon.config.keys import ConfigKey, about_section, heading_of, keys_of, toml_value
from mkdaemon.config.layers import DEFAULT, Value, find_key, values_of
from mkdaemon.config.mistakes import MistakesError
from mkdaemon.config.reader import COMMAND_LINE, validated
from mkdaemon.config.root import Config, DaemonSections
from mkdaemon.errors import ConfigError
from mkdaemon.files import save

WIDTH: Final = 100
"""Of explanations and comments [columns]."""
BEGIN_WITH: Final = (
    "vehicle.name",
    "vehicle.note",
    "link.port",
    "link.wait_for_port",
    "bus.listen",
    "control.limiter.max_pitch",
    "control.limiter.max_roll",
    "control.limiter.max_yaw",
    "control.limiter.min_throttle",
    "control.limiter.max_throttle",
    "control.limiter.hover_throttle",
    "control.autopilot.fence_radius",
    "control.autopilot.fence_height",
    "cameras.source",
    "cameras.calibration",
    "cameras.targets",
    "record.total_mb",
)
"""Keys that every aircraft has to think of."""
_RELOAD: Final = {True: "taken up by a running daemon (`systemctl reload mkdaemon`)", False: "needs a restart"}

app = App(name="config", help="Check, show, explain or create the configuration file of an aircraft.")


@app.command
def check(file: Path, *, options: RunOptions = NONE_GIVEN, as_json: AsJson = False) -> int:
    """Name every mistake of a configuration; nothing is opened, nothing is sent.

    Exit code 0 without a mistake, 2 with one. `mkdaemon doctor --config FILE` also looks whether what it names is
    there.

    Example: mkdaemon config check /etc/mkdaemon/vehicle.toml

    Args:
        file: TOML file.
        options: what `mkdaemon run` would be given.
    """
    from mkdaemon.daemon.runnable import mistakes

    count, note = 0, ""
    try:
        layered = load_configuration(file, options, whole=file_with("sim"))
        found = [str(mistake) for mistake in mistakes(layered.cfg, needs_port=False)]
        note = "" if layered.cfg.link.port else "; link.port is not set: name it with --port"
        count = len(layered.origins)
    except MistakesError as error:
        found = list(error.each)
    except ConfigError as error:
        found = [str(error)]
    fine = f"{on_one_line(file)}: no mistake; {count} keys are set, all others have their defaults{note}"
    words = "\n".join(map(on_one_line, found)) or fine
    printing.show({"file": str(file), "is_valid": not found, "mistakes": found}, words, as_json=as_json)
    return EXIT_CONFIG if found else EXIT_OK


@app.command
def show(
    file: Path | None = None,
    *,
    options: RunOptions = NONE_GIVEN,
    changed: bool = False,
    as_json: AsJson = False,
) -> None:
    """Show every value as `mkdaemon run` would have it, and where it comes from; what is printed is a file again.

    Example: mkdaemon config show vehicle.toml --changed

    Args:
        file: TOML file; without one defaults and environment alone.
        options: what `mkdaemon run` would be given.
        changed: Only what is no default.

    Raises:
        ConfigError: the file, or a value, is wrong.
    """
    layered = load_configuration(file, options)
    values = [value for value in values_of(layered) if not changed or value.origin != DEFAULT]
    if as_json:
        for value in values:
            print(
                printing.json_line(
                    {"key": f"{value.section}.{value.name}", "value": value.value, "origin": value.origin}
                )
            )
        return
    for line in _as_file(values):
        print(on_one_line(line))


def _as_file(values: list[Value]) -> Iterator[str]:
    """Values as a file has them, each with where it comes from."""
    for number, (section, group) in enumerate(groupby(values, attrgetter("section"))):
        head, _, rest = section.partition(".")
        index, _, inner = rest.partition(".")
        if number:
            yield ""
        if index.isdigit():
            yield f"[{head}.{inner}]" if inner else f"[[{head}]]"
        else:
            yield f"[{section}]"
        for value in group:
            if value.value is None:
                yield f"# {value.name}: unset".ljust(40) + f"  {value.origin}"
            else:
                yield f"{value.name} = {toml_value(value.value)}".ljust(40) + f"  # {value.origin}"


@app.command
def explain(key: str | None = None, *, as_json: AsJson = False) -> None:
    """Explain a key: what it is for, its type, unit, range and default, and what a wrong value does.

    Example: mkdaemon config explain link.gap_ms

    Args:
        key: A key, a section, or nothing for all sections.

    Raises:
        ConfigError: there is no such key; names the nearest.
    """
    files = documented_files()
    if key is None:
        for file in files:
            print(f"{file.title}\n  {file.about}" if file.about else file.title)
            for section in filter(None, file.sections()):
                print(f"  {file.heading(section):<22} {file.about_section(section)}")
        return
    known = [(file.title, each) for file in files for keys in file.sections().values() for each in keys]
    chosen = [each for each in known if each[1].section == key.strip("[]")]
    if not chosen:
        dotted = _dotted(key, [each for _, each in known])
        chosen = [each for each in known if each[1].dotted == dotted]
    is_one = len({each.dotted for _, each in chosen}) == 1
    for title, each in chosen:
        if as_json:
            print(printing.json_line({"key": each.dotted, "file": title, **each._asdict()}))
        elif is_one:  # in more than one kind of file, perhaps
            print("\n".join(_explanation(title, each)))
        else:
            print(f"{each.name:<22} {each.default.strip('`'):<16} {each.meaning}")


def _dotted(name: str, known: Sequence[ConfigKey]) -> str:
    """The key that a name stands for; where several end with it, the one that the daemon reads."""
    if all(each.dotted != name for each in known):
        with suppress(ConfigError):
            return find_key(name).dotted
    return find_key(name, known).dotted


def _explanation(title: str, key: ConfigKey) -> Iterator[str]:
    """A key in full."""
    yield f"{key.dotted}: {key.meaning}"
    is_daemons = key.section.partition(".")[0] in DaemonSections.model_fields
    rows = {
        "file": title,
        "type": key.kind,
        "unit": key.unit,
        "default": key.default.strip("`"),
        "range": key.limits,
        "if it is wrong": key.consequence,
        "change": _RELOAD[key.is_reloadable],
        "environment": ""
        if not is_daemons or _is_in_list(key.section)
        else f"MKDAEMON_{key.dotted.replace('.', '__').upper()}",
    }
    for name, text in rows.items():
        head = f"  {name:<15} "
        yield from textwrap.wrap(text, WIDTH, initial_indent=head, subsequent_indent=" " * len(head)) if text else ()


def _is_in_list(section: str) -> bool:
    """Whether there may be many of a section, so that no name says which is meant."""
    return heading_of(DaemonSections, section.partition(".")[0]).startswith("[[")


@app.command
def new(
    file: Path | None = None,
    *,
    options: RunOptions = NONE_GIVEN,
    all_keys: Annotated[bool, Parameter(name="--all")] = False,
    force: bool = False,
) -> None:
    """Begin a configuration file: what was given is set, all else stands there as a comment with its default.

    Example: mkdaemon config new vehicle.toml --vehicle mk1 --port /dev/ttyUSB0

    Args:
        file: Where to write it; without one it is printed.
        options: values to set.
        all_keys: Every key in place of those to begin with.
        force: Overwrite a file that is there.

    Raises:
        ConfigError: a value is wrong, or the file is there already.
    """
    given = options.by_key()
    text = "\n".join(_new_file(given, all_keys=all_keys)) + "\n"
    validated(Config, None, text, given, dict.fromkeys(given, COMMAND_LINE))
    if file is None:
        print(text, end="")
        return
    save(file, text, overwrite=force)
    print(f"wrote {on_one_line(file)}; edit it, then: mkdaemon config check {on_one_line(file)}")


def _new_file(given: dict[str, object], *, all_keys: bool) -> Iterator[str]:
    """The lines of a new file."""
    yield "# Configuration of one aircraft: docs/configuration.md, `mkdaemon config explain KEY`."
    yield "# A key behind # has its default; take the # away to change it."
    keys = [key for key in keys_of(DaemonSections) if all_keys or key.dotted in BEGIN_WITH or key.dotted in given]
    for section, group in groupby(keys, attrgetter("section")):
        heading = heading_of(DaemonSections, section)
        yield ""
        yield from _comment(about_section(DaemonSections, section))
        yield f"# {heading}" if _is_in_list(section) else heading  # a header alone would be a table already
        for key in group:
            unit = f" [{key.unit}]" if key.unit else ""
            yield from _comment(f"{key.meaning}{unit}{f' ({key.limits})' if key.limits else ''}")
            default = "..." if key.default in ("unset", "*required*") else key.default.strip("`")
            is_set = key.dotted in given
            yield f"{key.name} = {toml_value(given[key.dotted])}" if is_set else f"# {key.name} = {default}"


def _comment(text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent="# ", subsequent_indent="#   ", break_on_hyphens=False)
