"""One way to carry out a campaign: in one process or several, kept as it goes, limited in time, with its progress.

A campaign says what one flight, run or image is (`run`), and by which values it is named (`key`). This module does the
rest. A row is plain data, so that it can be kept in a file, summed up later, and compared with the row of another tree
that has the same key (`lab.compare`).
"""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import signal
import sys
import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, Final, Generic, TypeVar

from cyclopts import Parameter

from mkdaemon.errors import ConfigError, MkError

Row = dict[str, Any]
First = Annotated[int, Parameter(name=("--first", "--first-seed", "--seed"), help="First seed.")]
Jobs = Annotated[int, Parameter(help="Processes.")]
Kept = Annotated[
    Path | None,
    Parameter(help="File of rows, one JSON object a line; a run that was interrupted goes on with it."),
]
Asked = TypeVar("Asked")
Result = TypeVar("Result")

ONE_THREAD: Final = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")
"""Processes of a campaign share the cores already: numpy's and OpenCV's libraries start no threads in them."""


class CampaignError(MkError):
    """A process of a campaign died, or a campaign kept no results."""


class Ending(StrEnum):
    """How a flight of a campaign ended, judged by the physics and the wire. Only `FINISHED` is a success."""

    FINISHED = "finished"
    """It did what it was flown for."""
    HELD = "held"
    """In the air and under control when its time was over."""
    REFUSED = "refused"
    """It never left the ground, and a refusal says why."""
    RELEASED = "released"
    """The daemon gave the aircraft to the pilot, for a right reason and in time."""
    WRONG = "wrong"
    """A promise was broken: a release that nothing explains, one that came too late, or a wrong claim."""
    LOST = "lost"
    """The aircraft broke or flew away."""
    FAILED = "failed"
    """It could not be carried out."""


class LimitReached(BaseException):
    """A flight computed for too long; no `Exception`, so that nothing within the flight takes it for one of its own."""


@dataclass(frozen=True, slots=True)
class Campaign(Generic[Asked]):
    """What is carried out many times.

    Attributes:
        name: of the rows in a file of results, and in the progress.
        run: carries out one and returns its row; a function of a module, so that another process finds it. An
            exception makes the row an `Ending.FAILED` with its reason, and costs no other row.
        key: plain values that name one piece of work.
        limit: processor time after which one has failed [s].
        is_alone: each needs a process of its own, because it leaves something behind.
    """

    name: str
    run: Callable[[Asked], Mapping[str, Any]]
    key: Callable[[Asked], Row]
    limit: float = math.inf
    is_alone: bool = False

    def rows(self, asked: Sequence[Asked], jobs: int = 1, results: Path | None = None) -> list[Row]:
        """Carry out all that is asked, and write on stderr how each ended.

        Args:
            asked: each with a key of its own.
            jobs: processes; the rows do not depend on it.
            results: file in which every row is kept as it ends; rows that it has are not carried out again.

        Returns:
            The rows with their keys, in the order of what was asked.

        Raises:
            CampaignError: a process died.
            ConfigError: the file is no file of results.
        """
        kept = Results(results)
        keys = [self.key(each) for each in asked]
        found = {n: key | row for n, key in enumerate(keys) if (row := kept.find(self.name, key)) is not None}
        left = [number for number in range(len(keys)) if number not in found]
        work = partial(_row_of, self.run, self.limit)
        began = time.monotonic()
        rows = each_result(work, [asked[number] for number in left], jobs, is_alone=self.is_alone)
        for count, (index, row) in enumerate(rows, 1):
            number = left[index]
            found[number] = keys[number] | row
            if row.get("ending") != Ending.FAILED:
                kept.add(self.name, keys[number], row)
            took = (time.monotonic() - began) / count
            words = f"{count} of {len(left)}, {minutes(took * (len(left) - count))} left"
            print(f"{self.name}: {words}: {described(keys[number], row)}", file=sys.stderr, flush=True)
        return [found[number] for number in range(len(keys))]


def described(key: Mapping[str, Any], row: Mapping[str, Any]) -> str:
    """A row in a line: its key, how it ended and why."""
    named = " ".join(str(value) for value in key.values() if value is not None)
    return " ".join(part for part in (named, str(row.get("ending", "")), str(row.get("why", ""))) if part)


def _row_of(run: Callable[[Asked], Mapping[str, Any]], limit: float, asked: Asked) -> Row:
    """The row of one piece of work; an exception becomes one, too."""
    began = time.process_time()
    try:
        with _limited(limit):
            row = dict(run(asked))
    except (Exception, LimitReached) as error:  # whatever keeps one from its end, the others count  # noqa: BLE001
        row = {"ending": Ending.FAILED, "why": f"{type(error).__name__}: {error} ({place_of(error)})"}
    whole: Row = plain({**row, "processor_s": round(time.process_time() - began, 1)})
    return whole


def plain(value: Any) -> Any:
    """The same as JSON has it: numbers to four digits, None where one is not finite, words for what is named."""
    if isinstance(value, Mapping):
        return {str(name): plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, float):
        return round(value, 4) if math.isfinite(value) else None
    return str(value) if isinstance(value, StrEnum) else value


def place_of(error: BaseException) -> str:
    """The last line of the lab or of a test that an error passed, this module apart."""
    calls = [call for call in traceback.extract_tb(error.__traceback__) if call.filename != __file__]
    calls = [call for call in calls if {"lab", "tests"} & {*Path(call.filename).parts}]
    return f"{Path(calls[-1].filename).name}:{calls[-1].lineno} {calls[-1].name}" if calls else "outside the campaign"


@contextmanager
def _limited(limit: float) -> Iterator[None]:
    """Raise `LimitReached` in here once this process has computed for so long [s]."""
    if not math.isfinite(limit) or threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(number: int, frame: FrameType | None) -> None:
        raise LimitReached(f"not within {limit:g} s of processor time")

    before = signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, limit)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def each_result(
    work: Callable[[Asked], Result], asked: Sequence[Asked], jobs: int = 1, *, is_alone: bool = False
) -> Iterator[tuple[int, Result]]:
    """Do each piece of some work, and yield its number and its result as it ends.

    Args:
        work: a function of a module.
        asked: what it is called with.
        jobs: processes; 1 for this one, with the results in the order of `asked`.
        is_alone: each piece gets a process of its own.

    Raises:
        CampaignError: a process died.
        Exception: `work` raised it.
    """
    if min(jobs, len(asked)) <= 1 and not is_alone:
        yield from enumerate(map(work, asked))
        return
    spawn, most = multiprocessing.get_context("spawn"), max(1, min(jobs, len(asked)))
    tasks = 1 if is_alone else None
    with _one_thread_each(), ProcessPoolExecutor(most, spawn, initializer=_begin, max_tasks_per_child=tasks) as pool:
        futures = {pool.submit(work, each): number for number, each in enumerate(asked)}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BrokenProcessPool:
            pool.shutdown(wait=False, cancel_futures=True)
            msg = "a process of the campaign died, perhaps for want of memory; use fewer --jobs"
            raise CampaignError(msg) from None
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def in_order(
    work: Callable[[Asked], Result], asked: Sequence[Asked], jobs: int = 1, *, is_alone: bool = False
) -> list[Result]:
    """The results of some work in the order of what was asked; see `each_result`."""
    found = dict(each_result(work, asked, jobs, is_alone=is_alone))
    return [found[number] for number in range(len(asked))]


def _begin() -> None:
    """First thing in a new process: Ctrl-C is the parent's to handle."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


# -- rows that are kept -----------------------------------------------------------------------------------------------


@dataclass(slots=True)
class Results:
    """Rows of campaigns in a file, one JSON object a line, that grows with every row.

    Attributes:
        path: the file; None keeps the rows here only.
        rows: by campaign, each with its key, in the order in which they came.
    """

    path: Path | None
    rows: dict[str, list[Row]] = field(default_factory=dict)
    _found: dict[tuple[str, str], Row] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Read the file where there is one, and cut off a last line that was not written to its end.

        Raises:
            ConfigError: a line of it is no row.
        """
        if self.path is None or not self.path.exists():
            return
        text = self.path.read_text(encoding="utf-8")
        whole, end, torn = text.rpartition("\n")
        if torn:
            print(f"{self.path}: its last line is not whole, and is left out", file=sys.stderr)
            self.path.write_text(whole + end, encoding="utf-8")
        for number, line in enumerate(whole.splitlines(), 1):
            try:
                each = json.loads(line)
                self._take(str(each["campaign"]), dict(each["key"]), dict(each["row"]))
            except (ValueError, KeyError, TypeError) as error:
                msg = f"{self.path}:{number}: no row of a campaign ({error}); move the file away or name another"
                raise ConfigError(msg) from None

    def find(self, campaign: str, key: Mapping[str, Any]) -> Row | None:
        """The row with this key, without it; None where there is none."""
        return self._found.get((campaign, _name(key)))

    def add(self, campaign: str, key: Mapping[str, Any], row: Mapping[str, Any]) -> None:
        """Add a row, and write it."""
        self._take(campaign, dict(key), dict(row))
        if self.path is not None:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"campaign": campaign, "key": key, "row": row}) + "\n")

    def by_key(self, campaign: str) -> dict[str, Row]:
        """The rows of a campaign, without their keys, by their keys as text."""
        return {key: row for (of, key), row in self._found.items() if of == campaign}

    def _take(self, campaign: str, key: Row, row: Row) -> None:
        self.rows.setdefault(campaign, []).append(key | row)
        self._found[campaign, _name(key)] = row


def _name(key: Mapping[str, Any]) -> str:
    return " ".join(f"{name}={json.dumps(value)}" for name, value in sorted(key.items()))


# -- what rows say ----------------------------------------------------------------------------------------------------


def endings(rows: Sequence[Mapping[str, Any]]) -> Row:
    """How many rows ended how, and why those that did not finish: the first figure of every campaign that flies."""
    counts = Counter(row.get("ending", Ending.FINISHED) for row in rows)
    return {
        "flights": len(rows),
        **{ending.value: counts[ending] for ending in Ending if counts[ending] or ending in _ALWAYS},
        "unfinished": [f"{row.get('seed', '')}: {row['ending']}: {row.get('why', '')}" for row in rows if _is_bad(row)],
    }


_ALWAYS: Final = (Ending.FINISHED, Ending.RELEASED, Ending.LOST)


def carried_out(rows: Sequence[Row]) -> list[Row]:
    """The rows without those that could not be carried out."""
    return [row for row in rows if row.get("ending") != Ending.FAILED]


def summed_up(rows: Sequence[Row], *names: str, **goals: tuple[float, float]) -> Row:
    """What rows of one kind say together.

    Args:
        rows: of a campaign.
        names: figures of a row; one that is missing or None does not count.
        goals: of these figures: which share of the rows, and what that share does not exceed.

    Returns:
        How they ended; of each figure the median, nine tenths and the largest; `holds`: all finished, within the goals.
    """
    found = endings(rows)
    values = {name: sorted(row[name] for row in rows if row.get(name) is not None) for name in names}
    found |= {
        name: {str(share): round(quantile(each, share), 2) for share in SHARES if each} for name, each in values.items()
    }
    is_near = all(quantile(values[name], share) <= most for name, (share, most) in goals.items())
    return found | {"holds": is_near and all(row["ending"] == Ending.FINISHED for row in rows)}


SHARES: Final = (0.5, 0.9, 1.0)


def quantile(ordered: Sequence[float], share: float) -> float:
    """The value below which a share of sorted values lies, between two of them by line; not a number for none."""
    if not ordered:
        return math.nan
    low, rest = divmod(share * (len(ordered) - 1), 1.0)
    below = ordered[int(low)]
    return below + rest * (ordered[int(low) + 1] - below) if rest and math.isfinite(below) else below


def _is_bad(row: Mapping[str, Any]) -> bool:
    return row.get("ending", Ending.FINISHED) not in {Ending.FINISHED, Ending.REFUSED}


def minutes(seconds: float) -> str:
    """As 1:05."""
    whole = round(seconds)
    return f"{whole // 60}:{whole % 60:02d}"
