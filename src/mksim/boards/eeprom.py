"""What a FlightCtrl keeps without power: five parameter sets, the active one, the mixer, motor controller settings.

Kept in a JSON file when one is configured, so that a settings session on the simulator survives a restart.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

from mkdaemon.errors import ConfigError
from mkdaemon.files import write_whole
from mkdaemon.foreignfiles import parse_json, read_text
from mksim.boards.parameters import FACTORY_ACTIVE, SETS, Parameters, factory_set, parameter_size

MIXER_SIZE: Final = 77
MIXER_REVISION: Final = 1
BL_SIZE: Final = 8
MOTORS: Final = 4
_ROWS: Final = ((64, 64, 0, 64), (64, -64, 0, 64), (64, 0, -64, -64), (64, 0, 64, -64))
"""The factory quadrocopter: throttle, pitch, roll, yaw of motors 1..4, 64 = 100 %. Source: docs/protocol.md, 7."""
_BL_FACTORY: Final = bytes.fromhex("0200ff1e634000")


def bl_checksum(config: bytes) -> int:
    """Checksum of the first seven bytes of a motor controller's settings. Source: docs/protocol.md, section 7."""
    return (0xAA + sum(config[: BL_SIZE - 1])) & 0xFF


def _factory_mixer() -> bytes:
    rows = [value & 0xFF for row in _ROWS for value in row]
    return bytes([MIXER_REVISION]) + b"Quadro".ljust(12, b"\0") + bytes(rows).ljust(64, b"\0")


class Eeprom:
    """The stored state.

    Attributes:
        sets: parameter sets 1..5, raw.
        active: number of the active set.
        mixer: the mixer table, raw, without checksum.
        motor_configs: settings of each motor controller, raw, with checksum.
    """

    def __init__(self, revision: int, path: Path | None = None, *, gate_parameter: int = 0) -> None:
        """Read `path`, or start with factory values where it does not exist.

        Args:
            revision: of the parameter sets.
            path: the file; None keeps nothing.
            gate_parameter: ExternalControl in fresh sets; 0 as from the factory.

        Raises:
            ConfigError: the file is not an EEPROM file, belongs to another settings revision or cannot be written.
        """
        self._revision = revision
        self._path = path
        self._gate_parameter = gate_parameter
        self.sets = {number: self._factory(number) for number in range(1, SETS + 1)}
        self.active = FACTORY_ACTIVE
        self.mixer = _factory_mixer()
        factory = _BL_FACTORY + bytes([bl_checksum(_BL_FACTORY)])
        self.motor_configs = [factory] * MOTORS
        if path is not None and path.exists():
            self._read(path)
        self.save()  # a place that cannot be written is an error now, not in flight

    def _factory(self, number: int) -> bytes:
        return Parameters(factory_set(self._revision, number)).with_value("external_control", self._gate_parameter)

    def reset_set(self, number: int, *, keep_channels: bool) -> None:
        """Give a set its factory values."""
        fresh = bytearray(self._factory(number))
        if keep_channels:
            fresh[1:9] = self.sets[number][1:9]
        self.sets[number] = bytes(fresh)

    def save(self) -> None:
        """Write the file, if there is one; a crash leaves the old one whole.

        Raises:
            ConfigError: it cannot be written.
        """
        if self._path is None:
            return
        content = {
            "revision": self._revision,
            "active": self.active,
            "sets": {str(number): raw.hex() for number, raw in self.sets.items()},
            "mixer": self.mixer.hex(),
            "motor_configs": [raw.hex() for raw in self.motor_configs],
        }
        try:
            write_whole(self._path, json.dumps(content, indent=1) + "\n", overwrite=True)
        except OSError as error:
            msg = f"sim.eeprom {self._path}: {error.strerror or error}; name a file in a folder that can be written"
            raise ConfigError(msg) from None

    def _read(self, path: Path) -> None:
        try:
            content = parse_json(read_text(path, encoding="ascii"))
            revision = content["revision"]
            sets = {int(number): bytes.fromhex(raw) for number, raw in content["sets"].items()}
            active, mixer = int(content["active"]), bytes.fromhex(content["mixer"])
            configs = [bytes.fromhex(raw) for raw in content["motor_configs"]]
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            msg = f"{path} is not a simulator EEPROM file ({error}); delete it to start from factory values"
            raise ConfigError(msg) from error
        if revision != self._revision:
            msg = (
                f"{path} holds settings revision {revision}, this FlightCtrl has {self._revision}; "
                "name another file in sim.eeprom or delete it"
            )
            raise ConfigError(msg)
        sizes = {len(raw) for raw in sets.values()}
        is_whole = (
            set(sets) == set(self.sets)
            and sizes == {parameter_size(revision)}
            and active in sets
            and len(mixer) == MIXER_SIZE
            and [len(raw) for raw in configs] == [BL_SIZE] * MOTORS
        )
        if not is_whole:
            msg = f"{path} is incomplete; delete it to start from factory values"
            raise ConfigError(msg)
        self.sets, self.active, self.mixer, self.motor_configs = sets, active, mixer, configs
