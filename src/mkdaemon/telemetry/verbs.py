"""The one table of verbs: what a client may ask the daemon for by a query to `do/<verb>`.

The table of keys, docs/keys.md, the methods of the client and `mkctl do` are made from it. The daemon's part is a
handler in `daemon/verbs.py`, or for a procedure a line in `daemon/procedures/table.py`.
"""

from dataclasses import dataclass
from typing import Final

from mkdaemon.described import Described
from mkdaemon.telemetry import command, control, mission, navi, path, preflight, procedure, record, settings
from mkdaemon.telemetry.base import Command
from mkdaemon.telemetry.procedure import ProcedureRequest

ANSWER_TIME: Final = 15.0
"""Longest wait for an answer [s]; requests to a board with retries take up to 8 s."""
READING_TIME: Final = 60.0
"""The same where a board is read many times, or a procedure comes to its end first [s]."""
PROCEDURE_TIME: Final = 600.0
"""Longest wait for the end of a procedure [s]; 128 waypoints or five sets take some minutes on a bad line."""


@dataclass(frozen=True, slots=True)
class Verb:
    """One verb.

    Attributes:
        name: last word of its key.
        about: what it does, in one sentence.
        request: what is asked.
        reply: what is answered; None where nothing is.
        call: `<service>.<method>` of the client, or just `<method>` of the vehicle; by default the parts of the name.
            The command line has the same words, with `-` for `_`.
        patience: longest wait for the answer [s]; by default that of a question, or of a procedure.
        has_method: its method is made from this line; False where one is written by hand.
    """

    name: str
    about: str
    request: type[Command]
    reply: type[Described] | None = None
    call: str = ""
    patience: float = 0.0
    has_method: bool = True

    def __post_init__(self) -> None:
        """Fill in what follows from the name and the request."""
        service, _, method = self.name.rpartition("_")
        if not self.call:
            object.__setattr__(self, "call", f"{service}.{method}".removeprefix("."))
        if not self.patience:
            object.__setattr__(self, "patience", PROCEDURE_TIME if self.is_procedure else ANSWER_TIME)

    @property
    def service(self) -> str:
        """Object of the client that it belongs to; empty for the vehicle itself."""
        return self.call.rpartition(".")[0]

    @property
    def method(self) -> str:
        """Its name there."""
        return self.call.rpartition(".")[2]

    @property
    def is_procedure(self) -> bool:
        """Whether it takes many requests, and reports progress."""
        return issubclass(self.request, ProcedureRequest)


VERBS: Final[tuple[Verb, ...]] = (
    Verb(
        "lease",
        "Take, renew, give back or show the lease.",
        command.LeaseRequest,
        control.HolderGrant,
        has_method=False,
    ),
    Verb("release", "Release the aircraft now; every client may.", command.ReleaseRequest, control.ReleaseReport),
    Verb("gains", "The model in use, its gains and margins.", command.GainsRequest, control.Gains),
    Verb("preflight", "Make every check before a flight.", command.PreflightRequest, preflight.PreflightReport),
    Verb("abort", "Stop the manoeuvre and hold, or level; every client may.", command.AbortRequest),
    Verb(
        "accept_aircraft",
        "Accept the other aircraft that is at the port since it reopened.",
        command.AcceptAircraftRequest,
        call="accept_aircraft",
    ),
    Verb(
        "path_upload",
        "Check a path, and keep it to be flown.",
        path.PathUploadRequest,
        path.PathStored,
        call="paths.upload",
    ),
    Verb("rates", "Ask for a stream at a rate, or show all.", command.RatesRequest, command.Rates),
    Verb(
        "labels",
        "Names of a board's debug channels, kept by firmware.",
        command.LabelsRequest,
        command.Labels,
        patience=READING_TIME,
    ),
    Verb("settings_backup", "Read parameter sets.", settings.SettingsBackupRequest, settings.SettingsBackup),
    Verb("settings_compare", "Compare parameter sets.", settings.SettingsCompareRequest, settings.SettingsComparison),
    Verb(
        "settings_restore",
        "Write parameter sets that differ.",
        settings.SettingsRestoreRequest,
        settings.SettingsRestoration,
    ),
    Verb("settings_write", "Change parameters by name.", settings.SettingsWriteRequest, settings.SettingsRestoration),
    Verb(
        "settings_recover",
        "Restore a live set left unproven.",
        settings.SettingsRecoverRequest,
        settings.OwedSets,
    ),
    Verb("waypoints_upload", "Replace the NaviCtrl's list.", mission.WaypointsUploadRequest, mission.WaypointsStored),
    Verb("waypoints_read", "Read the NaviCtrl's list.", mission.WaypointsReadRequest, mission.WaypointList),
    Verb(
        "waypoints_verify",
        "Compare the list with a mission.",
        mission.WaypointsVerifyRequest,
        mission.WaypointsComparison,
    ),
    Verb("waypoints_clear", "Empty the list.", mission.WaypointsClearRequest, mission.WaypointsStored),
    Verb("route_start", "Make the list ready.", mission.RouteStartRequest, mission.RouteStarted),
    Verb("route_end", "Empty the list, in flight too.", mission.RouteEndRequest, mission.WaypointsStored),
    Verb(
        "navi_goto",
        "Set the NaviCtrl's target, in flight.",
        navi.NaviGotoRequest,
        navi.NaviTarget,
        call="navi.target",
    ),
    Verb("mixer_read", "Read the mixer.", settings.MixerReadRequest, settings.MixerTable),
    Verb("mixer_write", "Store a mixer.", settings.MixerWriteRequest, settings.MixerTable),
    Verb(
        "motor_controllers_read",
        "Read motor controllers.",
        settings.MotorControllersReadRequest,
        settings.MotorControllers,
    ),
    Verb(
        "motor_controllers_write",
        "Change a motor controller.",
        settings.MotorControllersWriteRequest,
        settings.MotorControllers,
    ),
    Verb("mark", "Mark this moment in all recordings; needs no lease.", record.MarkRequest, call="records.mark"),
    Verb("cancel", "End the procedure that runs.", procedure.CancelRequest, procedure.Cancelled, patience=READING_TIME),
)
"""Every verb."""
