"""The proving ground: the user's genuine FlightCtrl firmware flies in virtual time; see docs/lab/genuine.md."""
