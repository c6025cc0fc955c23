"""Files that are whole or not there: written beside their place, flushed to the disk, then renamed."""

from __future__ import annotations

import errno
import getpass
import os
import stat
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, Final

from mkdaemon.errors import ConfigError, MkError

_BASES: Final = {"XDG_STATE_HOME": Path(".local", "state"), "XDG_CONFIG_HOME": Path(".config")}
"""Folders of a user by the variable that moves them, and their usual place at home."""
_reading_umask = threading.Lock()


def user_folder(variable: str) -> Path:
    """Folder of this user for our files. Source: XDG Base Directory Specification 0.8.

    Args:
        variable: `XDG_STATE_HOME` or `XDG_CONFIG_HOME`.

    Raises:
        ConfigError: the user has no home: no `HOME`, and no entry in passwd, as in a container run with `--user`.
    """
    given = os.environ.get(variable)
    if given:
        return Path(given) / "mkdaemon"
    try:
        return Path.home() / _BASES[variable] / "mkdaemon"
    except RuntimeError as error:
        msg = f"user {os.getuid()} has no home folder; set HOME or {variable}, for the daemon also vehicle.state_folder"
        raise ConfigError(msg) from error


def user_name() -> str:
    """Name of this user; the number of one that has no entry in passwd."""
    try:
        return getpass.getuser()
    except (KeyError, OSError, ImportError):
        return str(os.getuid())


def refuse_existing(path: Path, *, overwrite: bool) -> None:
    """Check that a file may be written, before the work that fills it.

    Raises:
        ConfigError: it is there already, and `overwrite` is off.
    """
    if path.exists() and not overwrite:
        msg = f"{path}: already exists; choose another name, or overwrite it with --force"
        raise ConfigError(msg)


def save(path: Path, content: str | bytes, *, overwrite: bool = False) -> None:
    """Write a file that a user asked for, whole or not at all.

    Args:
        path: the file; its folder must exist.
        content: text is written as UTF-8.
        overwrite: replace a file that is there.

    Raises:
        ConfigError: it is there already, and `overwrite` is off; or there is no such folder.
        MkError: it cannot be written, for example because the disk is full; what was there is untouched.
    """
    with saving(path, overwrite=overwrite) as file:
        file.write(content.encode() if isinstance(content, str) else content)


def write_whole(path: Path, content: str | bytes, *, overwrite: bool = False) -> None:
    """Write a file so that its place holds the old content or all of the new, whatever happens meanwhile.

    A symbolic link stays, and the file it names is replaced. A file that is replaced keeps its permissions.

    Args:
        path: the file; its folder must exist.
        content: text is written as UTF-8.
        overwrite: replace a file that is there.

    Raises:
        FileExistsError: it is there already, and `overwrite` is off.
        OSError: it cannot be written, for example because the disk is full, or what is there is a device; what was
            there is untouched.
    """
    with _fresh_file(path, overwrite=overwrite) as file:
        file.write(content.encode() if isinstance(content, str) else content)


@contextmanager
def saving(path: Path, *, overwrite: bool = False) -> Iterator[BinaryIO]:
    """Open a file that a user asked for and that is written bit by bit: it gets its name when the context ends well.

    Args:
        path: the file; its folder must exist.
        overwrite: replace a file that is there.

    Raises:
        ConfigError: it is there already, and `overwrite` is off; or there is no such folder.
        MkError: it cannot be written, for example because the disk is full; what was there is untouched.
    """
    refuse_existing(path, overwrite=overwrite)
    if not path.parent.is_dir():
        msg = f"{path}: there is no folder {path.parent}; create it first"
        raise ConfigError(msg)
    try:
        with _fresh_file(path, overwrite=overwrite) as file:
            yield file
    except OSError as error:
        msg = f"{path}: cannot be written ({error.strerror}); choose another place"
        raise MkError(msg) from error


@contextmanager
def _fresh_file(path: Path, *, overwrite: bool) -> Iterator[BinaryIO]:
    """A file beside its place that gets the name when the context ends well; see `write_whole`."""
    place = Path(os.path.realpath(path))
    mode = _mode_of(place)
    try:
        number, name = tempfile.mkstemp(prefix=f".{place.name}.", suffix=".new", dir=place.parent)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    fresh = Path(name)
    try:
        with os.fdopen(number, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        fresh.chmod(mode)
        _put_in_place(fresh, place, overwrite=overwrite)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        fresh.unlink(missing_ok=True)
    flush_folder(place.parent)


def flush_folder(folder: Path) -> None:
    """Bring a folder's names to the disk, so that a power failure keeps what was renamed or removed in it."""
    with suppress(OSError):  # some file systems cannot
        number = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)


def _mode_of(place: Path) -> int:
    """The permissions a file has, or a new one gets.

    Raises:
        OSError: what is there is no file: renaming would replace a device or a pipe by one.
    """
    try:
        found = place.stat().st_mode
    except FileNotFoundError:
        return 0o666 & ~_umask()
    if not stat.S_ISREG(found):
        raise OSError(errno.EINVAL, "is no file", str(place))
    return stat.S_IMODE(found)


def _put_in_place(fresh: Path, place: Path, *, overwrite: bool) -> None:
    """Give a written file its name.

    Raises:
        FileExistsError: the file exists, and `overwrite` is off.
    """
    if not overwrite:
        try:
            place.hardlink_to(fresh)
        except FileExistsError:
            raise
        except OSError:  # a file system without hard links
            if place.exists():
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(place)) from None
        else:
            return
    fresh.replace(place)


def _umask() -> int:
    """The process's umask; to read it, it must be set, for every thread."""
    with _reading_umask:
        mask = os.umask(0o077)
        os.umask(mask)
    return mask
