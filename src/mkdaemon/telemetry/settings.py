"""Parameter sets, mixer and motor controllers: what a client asks for, and what it is answered.

Parameter sets are bytes as they cross the line: revision first, padding behind the last field kept.
"""

from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from mkdaemon.described import Described
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.telemetry.procedure import ConfirmedRequest, ProcedureRequest

Slot = Annotated[int, Field(ge=1, le=5)]
"""Number of a parameter set."""
Motor = Annotated[int, Field(ge=1, le=16)]
"""Number of a motor."""
Byte = Annotated[int, Field(ge=0, le=255)]
"""An unsigned byte."""
Signed = Annotated[int, Field(ge=-128, le=127)]
"""A signed byte."""


class StoredSet(Described):
    """One parameter set of a FlightCtrl."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    slot: Slot
    """Its number."""
    raw: bytes = Field(min_length=1, max_length=200)
    """Its bytes, revision first."""


Sets = Annotated[tuple[StoredSet, ...], Field(strict=False, min_length=1, max_length=5)]


class SettingsBackupRequest(ProcedureRequest):
    """Read parameter sets: `do/settings_backup`. The active one is live again afterwards, proven."""

    slots: tuple[Slot, ...] = Field(default=(1, 2, 3, 4, 5), strict=False, max_length=5)
    """Which ones, besides the active one."""


class SettingsBackup(Telemetry):
    """Parameter sets of a FlightCtrl: the answer to `do/settings_backup`."""

    firmware: str
    """Its release, for example `2.12a`."""
    active: int
    """Number of the active set, which is live."""
    sets: tuple[StoredSet, ...]
    """The sets read, by number."""


class SettingsCompareRequest(ProcedureRequest):
    """Compare parameter sets with those of the FlightCtrl: `do/settings_compare`. Writes nothing."""

    sets: Sets
    """What to compare with."""


class SettingsComparison(Telemetry):
    """The FlightCtrl's sets beside the given ones: the answer to `do/settings_compare`."""

    firmware: str
    """Its release."""
    active: int
    """Number of the active set, which is live."""
    stored: tuple[StoredSet, ...]
    """The sets concerned, as the FlightCtrl holds them."""
    differing: tuple[int, ...]
    """Numbers of those that differ; padding is no difference."""


class SettingsRestoreRequest(ConfirmedRequest):
    """Write parameter sets that differ: `do/settings_restore`. The set that is active stays active."""

    sets: Sets
    """What to write."""
    dry_run: bool = False
    """Read and compare only; needs no `confirm`."""

    @property
    def is_confirmed(self) -> bool:
        """Whether nothing is left to be confirmed."""
        return self.confirm or self.dry_run


class SettingsWriteRequest(ConfirmedRequest):
    """Change parameters of one set by name: `do/settings_write`."""

    slot: Slot | None = None
    """Number of the set; null for the active one."""
    values: dict[str, int | str | list[int] | list[str]] = Field(min_length=1, strict=False)
    """New values by name; potis as `poti1`, bits as a list of names."""
    dry_run: bool = False
    """Read and compare only; needs no `confirm`."""

    @property
    def is_confirmed(self) -> bool:
        """Whether nothing is left to be confirmed."""
        return self.confirm or self.dry_run


class SettingsRestoration(Telemetry):
    """Sets found and written: the answer to `do/settings_restore` and `do/settings_write`."""

    firmware: str
    """Release of the FlightCtrl."""
    active: int
    """Number of the active set, before and after."""
    before: tuple[StoredSet, ...]
    """The sets concerned, as found."""
    stored: tuple[StoredSet, ...]
    """The same, read back afterwards; what the FlightCtrl changed on its own shows here. In a dry run as found, or as
    they would be written by name."""
    written: tuple[int, ...]
    """Numbers of the sets written, in order."""


class SettingsRecoverRequest(ConfirmedRequest):
    """Look after a live set that was left unproven: `do/settings_recover`."""

    action: Literal["show", "retry", "discard"] = "show"
    """`retry`: try at once; `discard` (needs `confirm`): forget every note, because you know what is live."""

    @property
    def is_confirmed(self) -> bool:
        """Whether nothing is left to be confirmed."""
        return self.confirm or self.action != "discard"


class OwedSet(Described):
    """A parameter set that was live when a procedure was cut off."""

    model_config = ConfigDict(frozen=True)

    id: str
    """Of the procedure."""
    verb: str
    """What it was."""
    holder: str
    """The client that asked."""
    stamp: Stamp
    """When the note was taken."""
    firmware: str
    """Release of the FlightCtrl it is about."""
    active: int
    """Number of the set."""
    is_owed: bool
    """Whether the aircraft on the line owes it: false where it is another aircraft."""
    detail: str
    """Its present result."""


class OwedSets(Telemetry):
    """Live sets that are not proven yet: the answer to `do/settings_recover`."""

    notes: tuple[OwedSet, ...]
    """Oldest first; empty when all is well."""


class MixerReadRequest(ProcedureRequest):
    """Read the mixer of the FlightCtrl: `do/mixer_read`."""


class MixerWriteRequest(ConfirmedRequest):
    """Store a mixer, read it back and compare: `do/mixer_write`. The FlightCtrl uses it at once."""

    name: str = Field(max_length=12, pattern=r"^[\x20-\x7e]*$")
    """At most twelve ASCII characters."""
    motors: tuple[Signed, ...] = Field(strict=False, min_length=64, max_length=64)
    """16 rows of throttle, pitch, roll, yaw; 64 is 100 %."""


class MixerTable(Telemetry):
    """The mixer of the FlightCtrl, as it holds it: the answer to `do/mixer_read` and `do/mixer_write`."""

    name: str
    """What it is called."""
    motors: tuple[int, ...]
    """16 rows of throttle, pitch, roll, yaw; 64 is 100 %."""


class MotorControllersReadRequest(ProcedureRequest):
    """Read the configuration of motor controllers: `do/motor_controllers_read`."""

    motors: tuple[Motor, ...] = Field(strict=False, min_length=1, max_length=16)
    """Which ones."""


class MotorControllersWriteRequest(ConfirmedRequest):
    """Change some items of one motor controller, read them back and compare: `do/motor_controllers_write`."""

    motor: Motor
    """Which one."""
    pwm_scaling: Byte | None = None
    """Limits the largest PWM; null keeps it, as for all items."""
    current_limit: Byte | None = None
    """[A]"""
    temperature_limit: Byte | None = None
    """[degC]"""
    current_scaling: Byte | None = None
    """Gain of the current measurement."""
    reverse: bool | None = None
    """Sense of rotation."""
    save: bool = False
    """Keep it in the controller's EEPROM; otherwise it is gone without power."""


class ControllerSettings(Described):
    """Configuration of one motor controller."""

    model_config = ConfigDict(frozen=True)

    motor: int
    """1..16."""
    revision: int
    """Of the configuration."""
    pwm_scaling: int
    """Limits the largest PWM."""
    current_limit: int
    """[A]"""
    temperature_limit: int
    """[degC]"""
    current_scaling: int
    """Gain of the current measurement."""
    bits: int
    """As on the wire."""
    reverse: bool
    """Sense of rotation."""


class MotorControllers(Telemetry):
    """Configurations: the answer to `do/motor_controllers_read` and `do/motor_controllers_write`."""

    controllers: tuple[ControllerSettings, ...]
    """As the controllers hold them."""
