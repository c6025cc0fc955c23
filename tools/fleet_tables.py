"""The tables of docs/lab/scale.md, of what `lab fleet --results` measured.

The prose is written by hand; a table stands between `<!-- table NAME -->` and `<!-- end -->`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

from tools.markdown import table

Results = Mapping[str, Any]
COLUMNS: Final = (
    ("aircraft", "vehicles"),
    ("daemon, % of a core each", "daemon_cpu_percent"),
    ("simulator, % each", "simulator_cpu_percent"),
    ("router, %", "router_cpu_percent"),
    ("daemon, MiB each", "daemon_mb"),
    ("router, MiB", "router_mb"),
    ("values/s", "values_per_s"),
    ("values lost, %", "lost_percent"),
    ("frames of the lines, lost", "line_lost"),
    ("late, p50 (ms)", "late_p50_ms"),
    ("p99 (ms)", "late_p99_ms"),
    ("longest (ms)", "late_max_ms"),
)


def _scale(results: Results) -> Iterator[str]:
    found = results["scale"]
    machine = found["machine"]
    yield f"{machine['cores']} cores, load {machine['load_at_the_end']} at the end.\n"
    rows = (tuple(_word(row[key]) for _, key in COLUMNS) for row in found["rows"])
    yield from table(tuple(head for head, _ in COLUMNS), rows)


def _bandwidth(results: Results) -> Iterator[str]:
    """By the smallest number of aircraft, which the machine carries without being late."""
    row = results["scale"]["rows"][0]
    groups = [(f"`{group}/**`", size) for group, size in row["groups_kb_per_s_each"].items()]
    named = [
        ("everything, `mk/**`", row["kb_per_s_each"]),
        ("`mkctl top --all`", row["fleet_view_kb_per_s_each"]),
        *groups,
    ]
    yield from table(("what is subscribed to", "kB/s of one aircraft"), ((name, f"{size:g}") for name, size in named))


def _cut(results: Results) -> Iterator[str]:
    if "cut" not in results:
        yield "No run of it is kept here."
        return
    found = results["cut"]
    others = ", ".join(found["others"])
    rows = [
        ("the fleet view says stale, and gone", f"{_s(found['told_stale'])}, {_s(found['told_gone'])} after the cut"),
        (
            "the other two",
            f"{others} all the time; nothing for {_s(found['others_gap'])} at most, {found['others_lost']} values lost",
        ),
        ("last setpoint that came through", f"{_s(found['last_setpoint'])} after the cut"),
        ("release on the wire", f"{_s(found['released'])} after that setpoint: {found['reason']}"),
        ("its client", f"after {_s(found['client_told'])}: {found['client_words']}"),
        *((f"{one['asked']}", f"{_s(one['took'])}: {one['words']}") for one in found["refusals"]),
        ("fresh telemetry, and a lease", f"{_s(found['fresh'])}, {_s(found['leased_again'])} after the link's return"),
        ("black box aboard", f"{found['aboard']} values in the cut, longest gap {_s(found['aboard_gap'])}"),
        ("recording on the ground", f"gap {_s(found['ground_gap'])}, {found['ground_lost']} values known as lost"),
    ]
    loss, delay = 100 * found["loss"], 2000 * found["delay"]
    yield f"{loss:g} % lost each way, {delay:g} ms there and back, cut for {_s(found['cut_for'])}:\n"
    yield from table(("what", "seen"), (tuple(_cell(word) for word in row) for row in rows))


def _s(seconds: float | None) -> str:
    return "never" if seconds is None else f"{seconds:.2f} s"


def _word(value: Any) -> str:
    return "-" if value is None else f"{value:g}"


def _cell(words: str) -> str:
    return " ".join(words.split())


TABLES: Final[Mapping[str, Callable[[Results], Iterator[str]]]] = {
    "scale": _scale,
    "bandwidth": _bandwidth,
    "cut": _cut,
}
"""What fills each place."""
