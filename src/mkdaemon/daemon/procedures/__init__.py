"""Procedures that take many requests, run by the daemon: verbs, the journal, recovery after a death."""

from mkdaemon.daemon.procedures.desk import ProcedureDesk
from mkdaemon.daemon.procedures.journal import Journal, state_folder
from mkdaemon.daemon.procedures.occupancy import Occupancy

__all__ = ["Journal", "Occupancy", "ProcedureDesk", "state_folder"]
