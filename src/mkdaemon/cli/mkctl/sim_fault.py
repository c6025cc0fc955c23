"""`mkctl sim`: the pilot and the faults of a running simulator."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any, Final

from cyclopts import App, Parameter

from mkdaemon.cli.arguments import AsJson
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.printing import json_line
from mkdaemon.errors import ConfigError
from mkdaemon.telemetry.sim_faults import FAULTS, FaultNumber, FaultSpec

app: Final = App(
    name="sim", help="Control a running simulator: its pilot and its faults. An aircraft has no such command."
)


@app.command
async def start(connection: Connection = HERE) -> None:
    """Ask the simulated pilot to begin now instead of after his waiting time, or once more after a landing.

    Says what he does, or waits for; `mkctl get sim/truth` shows it later.

    Example: mkctl sim start
    """
    async with connection.open() as client:
        reply = (await client.command("sim", "start", {})).require()
    doing = reply.get("pilot") or "was asked to begin"
    connection.show({"status": "accepted", "pilot": doing}, f"the pilot {doing}")


@app.command
async def fault(
    name: str,
    *values: Annotated[str, Parameter(help="parameter=value; `mkctl sim faults` shows them.")],
    seconds: Annotated[float | None, Parameter(help="Duration; by default as the table says.")] = None,
    stop: Annotated[bool, Parameter(help="Stop it instead.")] = False,
    connection: Connection = HERE,
) -> None:
    """Start a fault; `clear` stops all.

    Example: mkctl sim fault motor_weak motor=2 share=0.7 --seconds 5

    Args:
        name: Which fault.
    """
    if name == "clear":
        fields: dict[str, Any] = {"action": "clear"}
    elif stop:
        fields = {"action": "stop", "name": name}
    else:
        fields = {"action": "start", "name": name, "duration": seconds, "values": _parse(values)}
    async with connection.open() as client:
        answer = await client.command("sim", "fault", fields)
    running = answer.require()["active"]
    connection.show({"active": running}, f"running: {', '.join(running) or 'none'}")


@app.command
def faults(*, as_json: AsJson = False) -> None:
    """List every fault there is, what it does and what it takes.

    Example: mkctl sim faults
    """
    for name, spec in FAULTS.items():
        if as_json:
            print(json_line({"name": name, **asdict(spec)}))
            continue
        print(f"{name:13} {spec.effect}{_lasts(spec)}")
        for key, parameter in spec.parameters.items():
            if isinstance(parameter, FaultNumber):
                unit = f" {parameter.unit}" if parameter.unit else ""
                bounds = f"{parameter.low:g} to {parameter.high:g}{unit}, default {parameter.default:g}"
            else:
                bounds = f"{', '.join(parameter.choices)}, default {parameter.default}"
            print(f"{'':13}   {key}: {parameter.help} ({bounds})")


def _lasts(spec: FaultSpec) -> str:
    if spec.once:
        return " Happens once."
    return "" if spec.duration is None else f" Lasts {spec.duration:g} s by default."


def _parse(values: tuple[str, ...]) -> dict[str, float | str]:
    """Read `parameter=value` words; numbers are numbers."""
    parsed: dict[str, float | str] = {}
    for word in values:
        key, equals, value = word.partition("=")
        if not equals or not key:
            raise ConfigError(f"'{word}' is not a parameter=value; `mkctl sim faults` shows what each fault takes")
        try:
            parsed[key] = float(value)
        except ValueError:
            parsed[key] = value
    return parsed
