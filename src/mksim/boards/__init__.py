"""FlightCtrl and NaviCtrl as state machines in exact virtual time: bytes in and out, each with its time."""
