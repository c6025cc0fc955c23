"""The one table of what may begin, and the questions that are asked of it.

To add a check, add its row, and its refusal to `telemetry/refusals.py`; docs/safety.md and docs/flying.md print it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from mkdaemon.control.admission.beginnings import Beginning, Concern, NewManoeuvre
from mkdaemon.control.admission.boardrows import BUSY_ROWS, PROCEDURE_ROWS, REQUEST_ROWS
from mkdaemon.control.admission.flightrows import FLIGHT_ROWS, LEASE_ROWS
from mkdaemon.control.admission.navirows import NAVI_ROWS
from mkdaemon.control.admission.row import AdmissionRow, Rule, Verdict
from mkdaemon.control.admission.situation import Situation
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.preflight import Blocks, CheckState, Finding

ROWS: Final[tuple[AdmissionRow, ...]] = (
    *BUSY_ROWS,
    *LEASE_ROWS,
    *FLIGHT_ROWS,
    *REQUEST_ROWS,
    *PROCEDURE_ROWS,
    *NAVI_ROWS,
)
"""Every row, in the order in which the first one that stands is named."""
_ROWS_ABOUT: Final = {concern: tuple(row for row in ROWS if concern in row.concerns) for concern in Concern}


def refusal(beginning: Beginning, situation: Situation) -> CommandRejectedError | None:
    """Say why something must not begin now; None where it may. What a flight waits for is no refusal.

    Args:
        beginning: what is to begin.
        situation: in which.
    """
    return next(refusals(beginning, situation), None)


def refusals(beginning: Beginning, situation: Situation) -> Iterator[CommandRejectedError]:
    """Every reason why something must not begin now."""
    rules = _refusing(beginning, situation.flown)
    for row in _ROWS_ABOUT[beginning.concern]:
        if row.rule not in rules or not _is_asked(row, beginning) or (beginning.is_early and not row.is_early):
            continue
        if (found := row.look(situation, beginning).refusal) is not None:
            yield found


def waits_for(beginning: NewManoeuvre, situation: Situation) -> str:
    """Say what keeps a flight from beginning with this manoeuvre; empty for nothing.

    What refuses it is waited for, too: it may stand only since the newest setpoint was taken.

    Args:
        beginning: the manoeuvre that is streamed.
        situation: before the flight; in flight nothing is waited for.
    """
    if situation.flown is not None:
        return ""
    refused = refusal(beginning, situation)
    if refused is not None:
        return f"no flight begins: {refused.reason}"
    for row in _ROWS_ABOUT[beginning.concern]:
        if row.rule in {Rule.ENTRY, Rule.WAITS} and _is_asked(row, beginning):
            found = row.look(situation, beginning)
            if found.state is CheckState.STANDS:
                return f"waiting for {found.words}"
    return ""


def findings(situation: Situation) -> tuple[Finding, ...]:
    """Results of every check before a flight, as `mkctl preflight` shows them."""
    return tuple(_shown(row, row.look(situation, None)) for row in ROWS if row.is_shown)


def is_ready(found: tuple[Finding, ...]) -> bool:
    """Whether nothing prevents a flight against a target."""
    return all(each.state is not CheckState.STANDS or each.blocks is Blocks.NOTHING for each in found)


def _refusing(beginning: Beginning, flown: Concern | None) -> tuple[Rule, ...]:
    """The rules by which rows refuse a beginning while something is flown; `WAITS` and `ADVICE` never do."""
    is_manoeuvre = isinstance(beginning, NewManoeuvre)
    is_by_hand = is_manoeuvre and flown is not None and not flown.is_by_target
    if is_manoeuvre and _goes_on(beginning.concern, flown):
        return (Rule.ALWAYS, Rule.ENTRY) if is_by_hand else (Rule.ALWAYS,)
    return (Rule.ALWAYS, Rule.BEGINNING, Rule.ENTRY) if is_by_hand else (Rule.ALWAYS, Rule.BEGINNING)


def _is_asked(row: AdmissionRow, beginning: Beginning) -> bool:
    """Whether a row about a beginning is asked; some are not about a flight that goes on."""
    return row.is_asked_again or not (isinstance(beginning, NewManoeuvre) and beginning.is_resumed)


def _goes_on(wanted: Concern, flown: Concern | None) -> bool:
    """Whether an aircraft flies on as it does, or from the target to the way out: hold or landing."""
    is_way_out = flown is not None and flown.is_by_target and wanted in {Concern.HOLD, Concern.LAND}
    return wanted is flown or is_way_out


def _shown(row: AdmissionRow, verdict: Verdict) -> Finding:
    found = verdict.refusal
    return Finding(
        name=row.name,
        state=verdict.state,
        blocks=row.blocks,
        token=None if found is None else found.token,
        reason=verdict.words,
        fix="" if found is None else found.fix,
    )
