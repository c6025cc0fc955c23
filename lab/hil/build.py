"""`make hil`: build what the proving ground runs, from the user's own checkouts of firmware and of simavr.

Neither firmware nor simavr is part of this project (their licences); nothing is copied out of `build/hil`, which git
does not see. simavr needs three repairs for a FlightCtrl, made in the copies that are compiled:

* its I2C bus is five times too fast, so that the firmware's motor loop never waits;
* `EEPE` does not stay set while the EEPROM writes, so that a parameter set is lost byte by byte;
* its serial input shows a byte one character after its last bit, and keeps 64 bytes where the processor keeps three.

A NaviCtrl's firmware is compiled for this machine: no ARM is simulated, only the parts soldered around it (navictrl.c).
Two things differ from its own processor, and are made the same:

* `long` has 32 bits there: the copies say `int`;
* the assembly that lets interrupts nest becomes a call of the board's, which does what it says.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from lab.places import ROOT
from mkdaemon.errors import ConfigError

OUTPUT: Final = ROOT / "build" / "hil"
"""Everything that is built."""
LIBRARY: Final = OUTPUT / "board.so"
FIRMWARE: Final = OUTPUT / "firmware"
"""One folder a firmware: `firmware.elf`, `firmware.json`, `eeprom.bin`."""
SIMAVR_URL: Final = "https://github.com/buserror/simavr (tag v1.6)"
FIRMWARE_URL: Final = "https://github.com/cehberlin/MikroKopterFlightController (FlightCtrl 2.12a, a public fork)"
PACKAGES: Final = "gcc-avr avr-libc binutils-avr libelf-dev gcc make"
"""Of Debian, with the programs that build."""
CORES: Final = {"atmega1284p": "mega1284", "atmega644p": "mega644", "atmega644": "mega644"}
"""Processors of FlightCtrls, and what simavr calls them."""
REPAIRS: Final = {
    "avr_twi.c": (
        # a byte on the I2C bus takes the nine bits it takes at 100 kHz and above, not a fifth of them
        (
            "p->io.avr, twi_cycles, avr_twi_set_state_timer, p);",
            "p->io.avr, twi_cycles * 5, avr_twi_set_state_timer, p);",
        ),
    ),
    "avr_eeprom.c": (
        # EEPE stays set while a byte is being written
        ("static avr_cycle_count_t avr_eei_raise", "static int is_busy;\nstatic avr_cycle_count_t avr_eei_raise"),
        (
            "\tavr_raise_interrupt(p->io.avr, &p->ready);\n\treturn 0;",
            "\tis_busy = 0;\n\tavr_regbit_clear(p->io.avr, p->eepe);\n"
            "\tavr_raise_interrupt(p->io.avr, &p->ready);\n\treturn 0;",
        ),
        (
            "\tif (eempe && avr_regbit_get(avr, p->eepe)) {\t// write operation",
            "\tif (eempe && avr_regbit_get(avr, p->eepe) && !is_busy) {\n\t\tis_busy = 1;",
        ),
        (
            "\t// autocleared\n\tavr_regbit_clear(avr, p->eepe);",
            "\tif (is_busy)\n\t\tavr_regbit_set(avr, p->eepe);\n\telse\n\t\tavr_regbit_clear(avr, p->eepe);",
        ),
    ),
    "avr_uart.c": (
        # a received byte shows at once; one that comes while two are kept and a third is in the shift register is lost
        # (data sheet of the ATmega1284P, chapter 20.7)
        (
            "avr_cycle_timer_register(avr, p->cycles_per_byte, avr_uart_rxc_raise, p); // start the rx pump",
            "avr_cycle_timer_register(avr, 1, avr_uart_rxc_raise, p);",
        ),
        ('LOG_ERROR, "UART%c: %s: RX buffer overrun', 'LOG_TRACE, "UART%c: %s: RX buffer overrun'),
        ("} else if (uart_fifo_isfull(&p->input)) {", "} else if (uart_fifo_get_read_size(&p->input) >= 3) {"),
    ),
}
"""Of simavr's sources: what stands there, and what takes its place."""
OWN_LID: Final = re.compile(rb"^(\s*)ChannelGas = ExternalControl\.Gas;", re.MULTILINE)
STOCK_LID: Final = rb"\1if(ExternalControl.Gas < ChannelGas) ChannelGas = ExternalControl.Gas;"
"""A public fork takes our throttle as it is; stock firmware takes the smaller of the pilot's and ours."""

NO_RECEIVER: Final = re.compile(rb"(void LIBFC_ReceiverInit\(unsigned char \w+\)\s*\{)\s*\}")
"""The library that reads receivers was never public; a fork of 0.84 has an empty one in its place."""
PULSE_TRAIN: Final = rb"\1 TCCR1A = 0; TCCR1B = (1 << ICNC1) | (1 << ICES1) | 3; TIMSK1 |= (1 << ICIE1); }"
"""What the library does for a pulse train: timer 1 counts clocks by 64 and captures rising edges (ATmega644 data sheet,
chapter 13). The firmware's own interrupt measures the pulses."""


@dataclass(frozen=True, slots=True)
class Firmware:
    """A firmware that was built.

    Attributes:
        name: of its folder.
        elf: the program.
        mcu: processor, as simavr calls it.
        frequency: of its clock [Hz].
        symbols: address of every variable in RAM.
    """

    name: str
    elf: Path
    mcu: str
    frequency: int
    symbols: dict[str, int]


def built(name: str) -> Firmware:
    """A firmware that `make hil` built.

    Raises:
        ConfigError: there is none of this name; says what to fetch and run.
    """
    folder = FIRMWARE / name
    if not LIBRARY.exists() or not (folder / "firmware.json").exists():
        there = ", ".join(names()) or "none"
        raise ConfigError(
            f"firmware {name!r} is not built (there is: {there}). Fetch its sources, for example {FIRMWARE_URL}, and "
            f"{SIMAVR_URL}, then run: make hil FIRMWARE=<folder of the sources> SIMAVR=<folder of simavr>"
        )
    facts = json.loads((folder / "firmware.json").read_text())
    return Firmware(name, folder / "firmware.elf", facts["mcu"], facts["frequency"], facts["symbols"])


def names() -> list[str]:
    """Firmwares that were built."""
    return sorted(path.parent.name for path in FIRMWARE.glob("*/firmware.json"))


def build(sources: Path, simavr: Path) -> list[str]:
    """Build the board's library and a firmware; returns the names of what can be flown now.

    Raises:
        ConfigError: something is missing, or does not compile; says what.
    """
    if not (simavr / "simavr" / "sim" / "sim_avr.h").exists():
        raise ConfigError(f"{simavr}: no checkout of simavr; fetch {SIMAVR_URL}")
    makefile = next((path for name in ("makefile", "Makefile") if (path := sources / name).exists()), None)
    if makefile is None:
        raise ConfigError(f"{sources}: no makefile of a FlightCtrl; fetch for example {FIRMWARE_URL}")
    _build_library(simavr / "simavr")
    return _build_firmware(sources, makefile)


# -- simavr and the board -----------------------------------------------------------------------------------------


def _build_library(simavr: Path) -> None:
    """Compile simavr, repaired, and the board around it into one library."""
    work = OUTPUT / "simavr"
    work.mkdir(parents=True, exist_ok=True)
    _configure(work)
    for name in REPAIRS:
        text = repaired(name, (simavr / "sim" / name).read_text(encoding="latin1"))
        (work / name).write_text(text, encoding="latin1")
    sources = [path for path in sorted((simavr / "sim").glob("*.c")) if path.name not in {"run_avr.c", *REPAIRS}]
    sources += [simavr / "cores" / f"sim_{core}.c" for core in ("mega1284", "megax4", "mega644")]
    sources += [*(work / name for name in REPAIRS), ROOT / "lab" / "hil" / "board.c"]
    folders = (work, simavr / "sim", simavr / "sim" / "avr", simavr / "cores")
    command = ["gcc", "-O3", "-march=native", "-fPIC", "-shared", "-w", "-fno-semantic-interposition", "-flto=auto"]
    command += [f"-I{folder}" for folder in folders] + ["-include", str(work / "sim_core_config.h")]
    command += [str(path) for path in sources if path.exists()]
    run_tool([*command, "-o", str(LIBRARY), "-lelf", "-lm"], "the board's library (is libelf-dev installed?)")


def _configure(work: Path) -> None:
    """Write the two headers that simavr's own build would make: which processors there are."""
    cores = sorted(set(CORES.values()))
    known = "".join(f"#define CONFIG_{core.upper()} 1\n" for core in cores)
    (work / "sim_core_config.h").write_text(
        f'#ifndef SIM_CORE_CONFIG_H\n#define SIM_CORE_CONFIG_H\n#define CONFIG_SIMAVR_VERSION "1.6"\n{known}#endif\n'
    )
    declared = "".join(f"extern avr_kind_t {core};\n" for core in cores)
    listed = ", ".join(f"&{core}" for core in cores)
    (work / "sim_core_decl.h").write_text(
        '#ifndef SIM_CORE_DECL_H\n#define SIM_CORE_DECL_H\n#include "sim_core_config.h"\n'
        f"{declared}extern avr_kind_t * avr_kind[];\n"
        f"#ifdef AVR_KIND_DECL\navr_kind_t * avr_kind[] = {{ {listed}, NULL }};\n#endif\n#endif\n"
    )


def repaired(name: str, text: str) -> str:
    """A source of simavr with its repairs.

    Raises:
        ConfigError: it is another one.
    """
    for old, new in REPAIRS[name]:
        if old not in text:
            raise ConfigError(f"simavr's {name} is not that of tag v1.6, which the repairs are for; fetch {SIMAVR_URL}")
        text = text.replace(old, new)
    return text


# -- firmware -----------------------------------------------------------------------------------------------------


def _build_firmware(sources: Path, makefile: Path) -> list[str]:
    """Compile a copy of the sources; twice where they are a fork whose throttle has no lid."""
    name, text = sources.resolve().name, makefile.read_text(encoding="latin1")
    found = {key: re.search(rf"^{key}\s*=\s*(\S+)", text, re.MULTILINE) for key in ("MCU", "F_CPU")}
    mcu, frequency = (None if one is None else one.group(1) for one in found.values())
    facts = {"mcu": mcu or "atmega644p", "frequency": int(frequency or 20_000_000)}
    if facts["mcu"] not in CORES:
        raise ConfigError(f"{makefile}: a {mcu} is no processor of a FlightCtrl ({', '.join(CORES)})")
    names, main = [name], sources / "fc.c"
    if main.exists() and OWN_LID.search(main.read_bytes()):
        names.append(f"{name}-stock-lid")
    for each in names:
        _compile(sources, each, facts)
    return names


def _compile(sources: Path, name: str, facts: dict[str, object]) -> None:
    folder = FIRMWARE / name
    work = folder / "sources"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(sources, work, ignore=shutil.ignore_patterns(".git", "*.o", "*.elf", "*.hex"))
    main, library = work / "fc.c", work / "libfc.c"
    if name.endswith("-stock-lid"):
        main.write_bytes(OWN_LID.sub(STOCK_LID, main.read_bytes()))
    if library.exists():
        library.write_bytes(b"#include <avr/io.h>\n" + NO_RECEIVER.sub(PULSE_TRAIN, library.read_bytes()))
    run_tool(["make", "-C", str(work)], f"firmware {name}", check=False)
    elf = next(iter(sorted(work.glob("*.elf"))), None)
    if elf is None:
        raise ConfigError(f"firmware {name} does not compile; run to see why: make -C {work}")
    shutil.copy(elf, folder / "firmware.elf")
    (folder / "firmware.json").write_text(json.dumps(facts | {"symbols": _symbols(elf)}))


def _symbols(elf: Path) -> dict[str, int]:
    """Addresses of variables; RAM begins at 0x800000 in the ELF of an AVR."""
    listed = run_tool(["avr-nm", str(elf)], "the firmware's symbols")
    found = re.findall(r"^(\w+) [BbDd] ([^.\s]+)$", listed, re.MULTILINE)
    return {symbol: int(address, 16) & 0xFFFF for address, symbol in found}


def run_tool(command: list[str], what: str, *, check: bool = True) -> str:
    """What a tool printed.

    Raises:
        ConfigError: it failed, and `check` is set, or is not installed.
    """
    try:
        done = subprocess.run(command, capture_output=True, encoding="latin1", check=False)
    except FileNotFoundError:
        raise ConfigError(f"{command[0]} is not installed: apt-get install {PACKAGES}") from None
    if check and done.returncode:
        raise ConfigError(f"{what} cannot be built:\n{done.stderr[-2000:]}")
    return done.stdout


# -- NaviCtrl -----------------------------------------------------------------------------------------------------


NAVICTRL: Final = OUTPUT / "navictrl"
"""One folder a firmware, with its `navictrl.so`."""
NAVICTRL_URL: Final = "https://github.com/zakwiggy/navictrl (NaviCtrl 0.24b, a public fork)"
INCLUDES: Final = (".", "libstr91x/include", "usbinc", "usblibrary/inc")
LEFT_OUT: Final = {"ramfunc.c", "syscalls.c", "usb_desc.c", "usb_endp.c", "usb_istr.c", "usb_prop.c", "usb_pwr.c"}
"""What only the processor itself needs: boot loader, the C library's ends, the inside of the USB socket."""
LONG: Final = re.compile(rb"\blong\b(\s+long\b)?")
FLAGS: Final = (
    *("-std=gnu89", "-fgnu89-inline", "-fcommon", "-O1", "-w", "-fPIC", "-fwrapv", "-fno-strict-aliasing"),
    *("-fsanitize-coverage=trace-pc", "-Dasm(text)=board_assembly(text)", "-Dmain=firmware_main"),
)
"""The language is that of its compiler of 2010; the last but two calls the board in every basic block."""


def built_navictrl() -> Path:
    """The library of the NaviCtrl that `make hil` built; the first by name where there are several.

    Raises:
        ConfigError: there is none; says what to fetch and run.
    """
    for path in sorted(NAVICTRL.glob("*/navictrl.so")):
        return path
    raise ConfigError(
        f"no NaviCtrl is built. Fetch its sources, for example {NAVICTRL_URL}, then run: "
        "make hil NAVICTRL=<folder of the sources>"
    )


def build_navictrl(sources: Path) -> str:
    """Build a NaviCtrl from sources with their makefile and copy of the processor's library; returns its name.

    Raises:
        ConfigError: something is missing, or does not compile; says what.
    """
    if not ((sources / "main.h").exists() and (sources / "makefile").exists()):
        raise ConfigError(f"{sources}: no sources of a NaviCtrl; fetch for example {NAVICTRL_URL}")
    name = sources.resolve().name
    folder = NAVICTRL / name
    work = folder / "sources"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(sources, work, ignore=shutil.ignore_patterns(".git", "*.o", "*.lst", "*.hex", "*.pdf"))
    for path in (*work.rglob("*.c"), *work.rglob("*.h")):
        path.write_bytes(narrowed(path.read_bytes()))
    includes = [f"-I{work / folder}" for folder in INCLUDES]
    compiled = [(path, FLAGS) for path in files_of(work)]
    for path, flags in (*compiled, (ROOT / "lab" / "hil" / "navictrl.c", ("-O2", "-fPIC", "-Wall"))):
        command = ["gcc", "-c", *flags, *includes, str(path), "-o", str(work / f"{path.stem}.o")]
        run_tool(command, f"NaviCtrl {name} (0.24b is known to build): {path.name}")
    objects = sorted(str(path) for path in work.glob("*.o"))
    library = str(folder / "navictrl.so")
    run_tool(["gcc", "-shared", "-Wl,-Bsymbolic", "-o", library, *objects, "-lm"], f"NaviCtrl {name}")
    return name


def files_of(sources: Path) -> list[Path]:
    """The files that are compiled: those of its makefile, without what only the processor needs."""
    text = (sources / "makefile").read_text(encoding="latin1")
    listed = re.findall(r"^SRCARM\s*\+?=\s*([\w-]+\.c)\s*$", text, re.MULTILINE)
    return [sources / name for name in listed if name not in LEFT_OUT]


def narrowed(text: bytes) -> bytes:
    """A source in which `long` is `int`; `long long` stays."""
    return LONG.sub(lambda found: found.group(0) if found.group(1) else b"int", text)


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
            print(f"built: {name}. Fly it: python -m lab hil --case pair")
    except ConfigError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
