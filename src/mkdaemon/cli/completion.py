"""`mkctl --install-completion`, `mkdaemon --install-completion`: commands and options by Tab."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Literal

from cyclopts import App

from mkdaemon.errors import ConfigError, MkError

Shell = Literal["bash", "zsh", "fish"]


def installer(app: App) -> Callable[..., None]:
    """The command that installs the completion of a program.

    Args:
        app: the program, with all its commands.
    """

    def install_completion(*, shell: Shell | None = None, output: Path | None = None) -> None:
        """Let the shell complete commands and options by Tab, from its next start on.

        Args:
            shell: Which shell; the one it is started from by default.
            output: File of the script. By default the one where the shell looks, read by its startup file.

        Raises:
            ConfigError: the shell is none that is known.
            MkError: the script cannot be written.
        """
        from cyclopts.completion.detect import ShellDetectionError

        try:
            path = app.install_completion(shell=shell, output=output, add_to_startup=output is None)
        except (ShellDetectionError, ValueError):
            raise ConfigError("which shell is this? give --shell bash, zsh or fish") from None
        except OSError as error:
            raise MkError(f"the completion cannot be written: {error}; give another file by --output") from error
        print(f"{path}: {' '.join(app.name)} completes commands and options by Tab in every shell started from now on")

    return install_completion
