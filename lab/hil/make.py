"""`make hil`: build what the proving ground runs, from the user's own checkouts of firmware and of simavr."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final

from lab.hil.build import FIRMWARE_URL, SIMAVR_URL, build
from lab.hil.navibuild import NAVICTRL_URL, build_navictrl
from mkdaemon.errors import ConfigError

USAGE: Final = f"""make hil FIRMWARE=<folder of a FlightCtrl's sources> SIMAVR=<folder of simavr>
make hil NAVICTRL=<folder of a NaviCtrl's sources>
  sources, for example: {FIRMWARE_URL}
  simavr: {SIMAVR_URL}
  NaviCtrl: {NAVICTRL_URL}"""


def main(arguments: list[str]) -> int:
    """Build from folders given on the command line, empty for none: FlightCtrl, simavr, NaviCtrl; exit code."""
    firmware, simavr, navictrl = (*arguments, "", "", "")[:3]
    if not navictrl and not (firmware and simavr):
        print(USAGE, file=sys.stderr)
        return 2
    try:
        if firmware:
            names = build(Path(firmware), Path(simavr))
            print(f"built: {', '.join(names)}. Fly it: python -m lab hil --firmware {names[0]}")
        if navictrl:
            name = build_navictrl(Path(navictrl))
            print(f"built: {name}. Run it: python -m lab hil --case navictrl")
    except ConfigError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
