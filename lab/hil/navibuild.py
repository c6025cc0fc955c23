"""Builds a NaviCtrl for the proving ground, from the user's own checkout: `make hil NAVICTRL=DIR`.

Its firmware is compiled for this machine, from copies in `build/hil` that git does not see: no ARM is simulated, only
the parts soldered around it (navictrl.c). Two things differ from its own processor, and are made the same:

* `long` has 32 bits there: the copies say `int`;
* the assembly that lets interrupts nest becomes a call of the board's, which does what it says.
"""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from lab.hil.build import OUTPUT, run_tool
from lab.places import ROOT
from mkdaemon.errors import ConfigError

NAVICTRL: Final = OUTPUT / "navictrl"
"""One folder a firmware: `navictrl.so`, `navictrl.json`."""
NAVICTRL_URL: Final = "https://github.com/zakwiggy/navictrl (NaviCtrl 0.24b, a public fork)"
KNOWN: Final = "0.24b"
"""Releases that were built."""
LIBRARY_HEADER: Final = "libstr91x/include/91x_lib.h"
INCLUDES: Final = (".", "libstr91x/include", "usbinc", "usblibrary/inc")
LEFT_OUT: Final = {"ramfunc.c", "syscalls.c", "usb_desc.c", "usb_endp.c", "usb_istr.c", "usb_prop.c", "usb_pwr.c"}
"""What only the processor itself needs: boot loader, the C library's ends, the inside of the USB socket."""
LONG: Final = re.compile(rb"\blong\b(\s+long\b)?")
FLAGS: Final = (
    "-std=gnu89",
    "-fgnu89-inline",
    "-fcommon",
    "-O1",
    "-w",
    "-fPIC",
    "-fwrapv",
    "-fno-strict-aliasing",
    "-fsanitize-coverage=trace-pc",
    "-Dasm(text)=board_assembly(text)",
    "-Dmain=firmware_main",
)
"""The language is that of its compiler of 2010; the last but two calls the board in every basic block."""


@dataclass(frozen=True, slots=True)
class NaviFirmware:
    """A NaviCtrl's firmware that was built.

    Attributes:
        name: of its folder.
        library: the board.
        release: as it prints it, for example `0.24b`.
    """

    name: str
    library: Path
    release: str


def built_navictrl() -> NaviFirmware:
    """The NaviCtrl that `make hil` built; the first by name where there are several.

    Raises:
        ConfigError: there is none; says what to fetch and run.
    """
    for path in sorted(NAVICTRL.glob("*/navictrl.json")):
        return NaviFirmware(path.parent.name, path.parent / "navictrl.so", json.loads(path.read_text())["release"])
    raise ConfigError(
        f"no NaviCtrl is built. Fetch its sources, for example {NAVICTRL_URL}, then run: "
        "make hil NAVICTRL=<folder of the sources>"
    )


def build_navictrl(sources: Path) -> str:
    """Build a NaviCtrl; returns its name.

    Args:
        sources: folder of its sources, with its makefile and its copy of the processor's library.

    Raises:
        ConfigError: something is missing, or does not compile; says what.
    """
    if shutil.which("gcc") is None:
        raise ConfigError("gcc is not installed: apt-get install gcc")
    release = release_of(sources)
    name = sources.resolve().name
    folder = NAVICTRL / name
    work = folder / "sources"
    shutil.rmtree(folder, ignore_errors=True)
    copy_sources(sources, work)
    objects = [_compile(work, path, release, *FLAGS) for path in files_of(sources)]
    objects.append(_compile(work, ROOT / "lab" / "hil" / "navictrl.c", release, "-O2", "-fPIC", "-Wall"))
    linked = [str(path) for path in objects]
    run_tool(
        ["gcc", "-shared", "-Wl,-Bsymbolic", "-o", str(folder / "navictrl.so"), *linked, "-lm"], f"NaviCtrl {name}"
    )
    (folder / "navictrl.json").write_text(json.dumps({"release": release}))
    return name


def release_of(sources: Path) -> str:
    """Release of a NaviCtrl's sources, for example `0.24b`.

    Raises:
        ConfigError: they are none.
    """
    header = sources / "main.h"
    text = header.read_text(encoding="latin1") if header.exists() else ""
    parts = {key: re.search(rf"define\s+VERSION_{key}\s+(\d+)", text) for key in ("MAJOR", "MINOR", "PATCH")}
    numbers = {key: int(found.group(1)) for key, found in parts.items() if found}
    if len(numbers) < len(parts) or not (sources / "spi_slave.c").exists():
        raise ConfigError(f"{sources}: no sources of a NaviCtrl; fetch for example {NAVICTRL_URL}")
    if not (sources / LIBRARY_HEADER).exists():
        raise ConfigError(
            f"{sources}: {LIBRARY_HEADER} is missing: the sources need their copy of the processor's library"
        )
    return f"{numbers['MAJOR']}.{numbers['MINOR']:02d}{chr(ord('a') + numbers['PATCH'])}"


def files_of(sources: Path) -> list[str]:
    """Names of the files that are compiled: those of its makefile, without what only the processor needs."""
    makefile = sources / "makefile"
    text = makefile.read_text(encoding="latin1") if makefile.exists() else ""
    listed = re.findall(r"^SRCARM\s*\+?=\s*([\w-]+\.c)\s*$", text, re.MULTILINE)
    names = listed or sorted(path.name for path in sources.glob("*.c"))
    return [name for name in names if name not in LEFT_OUT]


def copy_sources(sources: Path, work: Path) -> None:
    """Copy the sources, with 32 bits where their processor has them."""
    shutil.copytree(sources, work, ignore=shutil.ignore_patterns(".git", "*.o", "*.lst", "*.hex", "*.pdf"))
    for path in (*work.rglob("*.c"), *work.rglob("*.h")):
        path.write_bytes(narrowed(path.read_bytes()))


def narrowed(text: bytes) -> bytes:
    """A source in which `long` is `int`; `long long` stays."""
    return LONG.sub(lambda found: found.group(0) if found.group(1) else b"int", text)


def _compile(work: Path, source: Path | str, release: str, *flags: str) -> Path:
    target = work / f"{Path(source).stem}.o"
    command = ["gcc", "-c", *flags, *(f"-I{work / folder}" for folder in INCLUDES)]
    known = "" if release == KNOWN else f" (it is {release}; {KNOWN} is the release that is known to build)"
    run_tool([*command, str(work / source), "-o", str(target)], f"NaviCtrl: {Path(source).name}{known}")
    return target
