"""`mkdaemon doctor`: what on this machine stands between us and an aircraft."""

from mkdaemon.cli.mkdaemon.doctor.command import doctor

__all__ = ["doctor"]
