"""The only place that knows both sides: wire messages in firmware units, and values in SI."""

from mkdaemon.translate.aircraft import aircraft_model, assumed_model
from mkdaemon.translate.control import extern_control
from mkdaemon.translate.state import StateTranslator

__all__ = ["StateTranslator", "aircraft_model", "assumed_model", "extern_control"]
