"""Procedures that take many requests, run by the daemon: verbs, the journal, recovery after a death."""

from mkdaemon.daemon.procedures.interlock import Interlock
from mkdaemon.daemon.procedures.journal import Journal, state_folder
from mkdaemon.daemon.procedures.runner import ProcedureRunner

__all__ = ["Interlock", "Journal", "ProcedureRunner", "state_folder"]
