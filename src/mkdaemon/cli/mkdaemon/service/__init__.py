"""`mkdaemon install-service`: systemd starts what belongs to an aircraft."""

from mkdaemon.cli.mkdaemon.service.installing import install_service

__all__ = ["install_service"]
