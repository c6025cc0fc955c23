"""The command: show, write or remove the units of systemd and the rules of udev."""

from __future__ import annotations

import sysconfig
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, NamedTuple

from mkdaemon.cli.mkdaemon.gateway import GATEWAYS
from mkdaemon.cli.mkdaemon.service.units import MARK, SETTINGS, flies, unit_text
from mkdaemon.cli.program import EXIT_FAILURE, EXIT_OK
from mkdaemon.cli.systemcommands import NOT_FOUND, CommandOutput, run_command
from mkdaemon.cli.terminal import on_one_line
from mkdaemon.config.names import require_vehicle_name
from mkdaemon.config.reader import samples_folder
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.files import write_whole

Part = Literal["daemon", "recorder", "gateway"]
CURRENT: Final = Path("/opt/mkdaemon")
"""Link to the installation that is in use: what is started through it survives an upgrade."""
RULES: Final = "60-mkdaemon.rules"


HIDDEN: Final = (Path("/home"), Path("/root"), Path("/run/user"))
"""What `ProtectHome=yes` hides from a service."""


class InstallStep(NamedTuple):
    """One thing that was done.

    Attributes:
        words: what.
        is_done: False where a command of the system failed.
    """

    words: str
    is_done: bool = True


@dataclass(frozen=True)
class Host:
    """The machine that units are written on; a test gives it another root.

    Attributes:
        root: of /etc and /opt.
        run: runs a command.
    """

    root: Path = Path("/")
    run: Callable[[Sequence[str]], CommandOutput] = run_command

    def at(self, path: Path) -> Path:
        """Where an absolute path lies."""
        return self.root / path.relative_to("/")


def install_service(
    *parts: Part,
    vehicle: str | None = None,
    gateway: str = "mavlink",
    programs: Path | None = None,
    write: bool = False,
    remove: bool = False,
    force: bool = False,
) -> int:
    """Let systemd start the daemon, the ground recorder or a gateway; without --write it only shows what it would do.

    The daemon's guard is started by the daemon. With --vehicle the unit is a template, and each aircraft of this
    machine has its own configuration, /etc/mkdaemon/NAME.toml, its own user and its own folders.

    Exit code 1 where a command of the system failed.

    Example: mkdaemon install-service --write

    Args:
        parts: What to install; the daemon without any.
        vehicle: Name of the vehicle, for one of many daemons on this machine.
        gateway: Name of the gateway, as `mkdaemon gateway` has it.
        programs: Folder of `mkdaemon` and `mkctl`; that of this installation by default.
        write: Write the files, and tell systemd and udev.
        remove: Stop what they start, and remove the files; recordings and configuration stay.
        force: Overwrite units that were written by hand.

    Raises:
        ConfigError: --write and --remove, or a unit was written by hand.
        MkError: a file cannot be written; says how.
    """
    if write and remove:
        raise ConfigError("--write and --remove: give one of them")
    host = Host()
    chosen = plan(parts or ("daemon",), vehicle, gateway)
    folder = programs or programs_folder(host)
    if not remove and (hidden := next((place for place in HIDDEN if folder.is_relative_to(place)), None)):
        msg = f"{folder}: no service may look below {hidden}; install into /opt (docs/operations.md) or give --programs"
        raise ConfigError(msg)
    if remove:
        steps = remove_units(host, chosen)
    elif write:
        steps = write_units(host, chosen, folder, force=force)
    else:
        steps = map(InstallStep, preview(host, chosen, folder))
    code = EXIT_OK
    for step in steps:
        print(on_one_line(step.words))
        code = code if step.is_done else EXIT_FAILURE
    return code


@dataclass(frozen=True)
class Planned:
    """One unit to install.

    Attributes:
        name: of the file.
        instance: argument of `systemctl`.
        settings: the file that it reads.
    """

    name: str
    instance: str
    settings: Path

    @property
    def path(self) -> Path:
        """Of its file."""
        return Path("/etc/systemd/system") / self.name


def plan(parts: Sequence[Part], vehicle: str | None, gateway: str) -> list[Planned]:
    """The units of some parts, and what their instances are called.

    Raises:
        ConfigError: no vehicle, or no gateway, can be called so.
    """
    if vehicle is not None:
        require_vehicle_name(vehicle, "--vehicle")
    names = [entry.name for entry in GATEWAYS]
    if "gateway" in parts and gateway not in names:
        raise ConfigError(f"--gateway {gateway!r}: there is {', '.join(names)}")
    found = []
    for part in dict.fromkeys(parts):
        if part == "daemon":
            name, instance, file = ("@", f"@{vehicle}", f"{vehicle}.toml") if vehicle else ("", "", "vehicle.toml")
        elif part == "gateway":
            name, instance, file = "-gateway@", f"-gateway@{gateway}", f"gateway-{gateway}.env"
        else:
            name, instance, file = "-recorder", "-recorder", "recorder.env"
        found.append(Planned(f"mkdaemon{name}.service", f"mkdaemon{instance}", SETTINGS / file))
    return found


def programs_folder(host: Host) -> Path:
    """Folder of the programs of this installation, through the link that an upgrade turns where there is one."""
    folder = Path(sysconfig.get_path("scripts"))
    current = host.at(CURRENT)
    if current.is_symlink():
        inside = current / ".venv" / "bin"
        if inside.resolve() == folder.resolve():
            return CURRENT / ".venv" / "bin"
    return folder


def preview(host: Host, chosen: Sequence[Planned], programs: Path) -> Iterator[str]:
    """What would be written, and typed."""
    for planned in chosen:
        state = _state(host.at(planned.path), unit_text(planned.name, programs))
        yield f"# {planned.path} ({state})"
        yield from unit_text(planned.name, programs).splitlines()
    if _needs_rules(chosen):
        yield f"# /etc/udev/rules.d/{RULES} ({_state(host.at(_rules_path()), _rules_text())})"
    yield f"# nothing was written: sudo {programs}/mkdaemon install-service ... --write does"


def write_units(host: Host, chosen: Sequence[Planned], programs: Path, *, force: bool = False) -> Iterator[InstallStep]:
    """Write units and rules, and tell systemd and udev.

    Raises:
        ConfigError: a unit was written by hand.
        MkError: a file cannot be written.
    """
    for planned in chosen:
        place = host.at(planned.path)
        if place.exists() and not place.read_text(encoding="utf-8").startswith(MARK) and not force:
            raise ConfigError(f"{planned.path} was written by hand: remove it, or overwrite it with --force")
    for planned in chosen:
        _write(host.at(planned.path), unit_text(planned.name, programs))
        yield InstallStep(f"wrote {planned.path}")
    if _needs_rules(chosen):
        _write(host.at(_rules_path()), _rules_text())
        yield InstallStep(f"wrote {_rules_path()}")
        yield from _typed(host, "udevadm", "control", "--reload")
    yield from _typed(host, "systemctl", "daemon-reload")
    for planned in chosen:
        if flies(planned.name) and not host.at(planned.settings).exists():
            yield InstallStep(
                f"next: sudo install -d {SETTINGS} && sudo {programs}/mkdaemon config new {planned.settings}"
            )
        yield InstallStep(f"next: sudo systemctl enable --now {planned.instance}")


def remove_units(host: Host, chosen: Sequence[Planned]) -> Iterator[InstallStep]:
    """Stop what the units start, and remove them; a template stays while another instance is enabled.

    Raises:
        MkError: a file cannot be removed.
    """
    for planned in chosen:
        place = host.at(planned.path)
        if not place.exists():
            yield InstallStep(f"{planned.path} is not there")
            continue
        yield from _typed(host, "systemctl", "disable", "--now", planned.instance)
        others = [
            link.name
            for link in host.at(Path("/etc/systemd/system/multi-user.target.wants")).glob("mkdaemon*@*.service")
            if "@" in planned.name
            and link.name.startswith(planned.name.partition("@")[0] + "@")
            and link.name != f"{planned.instance}.service"
        ]
        if others:
            yield InstallStep(f"{planned.path} stays: {', '.join(others)} is enabled")
            continue
        _remove(place)
        yield InstallStep(f"removed {planned.path}")
    rules = host.at(_rules_path())
    if _needs_rules(chosen) and not any(host.at(planned.path).exists() for planned in chosen) and rules.exists():
        _remove(rules)
        yield InstallStep(f"removed {_rules_path()}")
        yield from _typed(host, "udevadm", "control", "--reload")
    yield from _typed(host, "systemctl", "daemon-reload")
    yield InstallStep(f"kept: {SETTINGS}, /var/lib/mkdaemon (configuration, recordings, notes)")


def _needs_rules(chosen: Sequence[Planned]) -> bool:
    """Whether one of the units opens a serial line."""
    return any(flies(planned.name) for planned in chosen)


def _rules_path() -> Path:
    return Path("/etc/udev/rules.d") / RULES


def _rules_text() -> str:
    return (samples_folder() / "udev" / RULES).read_text(encoding="utf-8")


def _state(place: Path, text: str) -> str:
    """How a file differs from what would be written."""
    try:
        found = place.read_text(encoding="utf-8")
    except OSError:
        return "new"
    if found == text:
        return "there already"
    return "changes" if found.startswith(MARK) or place.name == RULES else "written by hand: needs --force"


def _write(place: Path, text: str) -> None:
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        write_whole(place, text, overwrite=True)
        place.chmod(0o644)
    except OSError as error:
        raise _refusal(place, error) from error


def _remove(place: Path) -> None:
    try:
        place.unlink()
    except OSError as error:
        raise _refusal(place, error) from error


def _refusal(place: Path, error: OSError) -> MkError:
    return MkError(f"{place}: {error.strerror}: run it with sudo")


def _typed(host: Host, *words: str) -> Iterator[InstallStep]:
    """Run a command of the system; on a machine without systemd or udev, report that."""
    answer = host.run(words)
    line = " ".join(words)
    is_done = answer.code == 0
    reason = "not installed" if answer.code == NOT_FOUND else f"exit code {answer.code}"
    yield InstallStep(f"typed {line}" if is_done else f"FAILED: {line} ({reason})", is_done)
