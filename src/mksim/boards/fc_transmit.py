"""Which frame a FlightCtrl sends next: at most one starts in a pass of the main loop, and only on an idle transmitter.

Source: docs/firmware-notes, "Losses" and "Subscriptions".
"""

from __future__ import annotations

from typing import Final

from mkdaemon.protocol.wire import Board
from mksim.boards import fc_display, fc_replies
from mksim.boards.fc_board import FcBoard

_COMPASS: Final = 0.099
_COMPASS_SLOW: Final = 0.999
"""Period of the compass feed without and with a NaviCtrl. Source: docs/protocol.md, section 9."""


def start_next_frame(board: FcBoard, now: float) -> None:
    """Start at most one frame; a label asked for while a debug frame starts collides with it."""
    requests = board.requests
    requests.end_expired(now, debug_is_endless=board.is_fork)
    if _start_first(board, now) or _start_compass_feed(board, now):
        return
    started = False
    if requests.debug or requests.debug_stream.is_due(now):
        requests.debug = False
        requests.debug_stream.restart(now)
        board.send(fc_replies.debug(board), now)
        started = True
    if requests.label is not None:
        index, requests.label = requests.label, None
        board.cut(now)
        board.send(fc_replies.name(index), now)
        return
    if not started:
        _start_last(board, now)


def _start_first(board: FcBoard, now: float) -> bool:
    """Version and external control go before everything."""
    requests = board.requests
    if requests.version is not None:
        reply = fc_replies.companion_version if requests.version == 2 else fc_replies.version
        requests.version = None
        board.send(reply(board), now)
        return True
    if requests.control:
        requests.control = False
        board.send(fc_replies.control_state(board), now)
        return True
    return False


def _start_compass_feed(board: FcBoard, now: float) -> bool:
    """Early firmware sends an MK3Mag its attitude, whether there is one or not."""
    if not board.generation.feeds_compass or now < board.requests.compass_at:
        return False
    board.requests.compass_at = now + (_COMPASS_SLOW if board.has_companion else _COMPASS)
    board.send(fc_replies.compass_feed(board), now, Board.MAG)
    return True


def _start_last(board: FcBoard, now: float) -> None:
    """Send what a fast debug stream starves."""
    requests = board.requests
    if board.external.confirm:
        board.send(fc_replies.confirm(board.external.confirm), now)
        board.external.confirm = 0
    elif requests.attitude_stream.is_due(now):
        requests.attitude_stream.restart(now)
        board.send(fc_replies.attitude(board), now)
    elif requests.display or requests.display_stream.is_due(now):
        requests.display = False
        requests.display_stream.restart(now)
        board.send(fc_display.display(board), now + fc_display.PRINT)
    elif requests.menu is not None:
        page, requests.menu = requests.menu, None
        board.send(fc_display.menu(board, page), now + fc_display.PRINT)
    elif requests.receiver:
        requests.receiver = False
        board.send(fc_replies.receiver(board), now)
