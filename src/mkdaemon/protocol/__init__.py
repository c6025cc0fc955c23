"""The MikroKopter serial protocol as a library: frames, typed messages, dialects, recordings and parameter sets.

Everything is pure: bytes in, values out; no port, no clock, no network. Importing this package fills the table of all
messages; the message classes are in `mkdaemon.protocol.messages`, their flags and enumerations in
`mkdaemon.protocol.flags`. A recording decodes in three lines::

    with open("flight.jsonl", "rb") as recording:
        for t, direction, frame, content in decode_capture(recording):
            print(t, direction, content)
"""

from mkdaemon.protocol import flags, messages
from mkdaemon.protocol.boards import Board, Direction, board_at
from mkdaemon.protocol.capture import Chunk, read_chunks
from mkdaemon.protocol.decoder import MessageDecoder, Unknown
from mkdaemon.protocol.dialect import Dialect, Evidence, decide
from mkdaemon.protocol.errorcodes import ErrorCode, describe_error
from mkdaemon.protocol.framing import Dropped, DropReason, Frame, FrameDecoder, encode_frame
from mkdaemon.protocol.generations import DeadMan, Release
from mkdaemon.protocol.settings import ParameterSet, known_revisions, layout_of
from mkdaemon.protocol.settings_file import SettingsFile
from mkdaemon.protocol.spec import MessageSpec
from mkdaemon.protocol.traffic import Decoded, TrafficDecoder, decode_capture, decode_chunks
from mkdaemon.protocol.wire import MESSAGES, WireMessage
from mkdaemon.telemetry.mission import Mission, MissionPoint

__all__ = [
    "MESSAGES",
    "Board",
    "Chunk",
    "DeadMan",
    "Decoded",
    "Dialect",
    "Direction",
    "DropReason",
    "Dropped",
    "ErrorCode",
    "Evidence",
    "Frame",
    "FrameDecoder",
    "MessageDecoder",
    "MessageSpec",
    "Mission",
    "MissionPoint",
    "ParameterSet",
    "Release",
    "SettingsFile",
    "TrafficDecoder",
    "Unknown",
    "WireMessage",
    "board_at",
    "decide",
    "decode_capture",
    "decode_chunks",
    "describe_error",
    "encode_frame",
    "flags",
    "known_revisions",
    "layout_of",
    "messages",
    "read_chunks",
]
