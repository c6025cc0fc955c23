"""The root of setpoint keys, known only to holders of a lease.

Each sample of a key with a subscriber in Python costs the interpreter, on one of the two threads on which Zenoh
receives from every connection. Two strangers that put 300,000 setpoints a second between them held up the pilot's for
0.05 s, p99 0.41 s, and 30 milliseconds without a subscriber at the strangers' key (two cores, `lab attack`).

The root's second chunk is a secret random number. It begins with `@`: such a chunk is matched by no wildcard, so
that neither a put to `mk/**` arrives there, nor a subscriber of `mk/**` hears what does. What arrives is put once more
to the plain key (`setpoint/stick`) by the daemon, for all readers.

A router's access rules stand in a file, and no pattern in a file can speak of such a chunk. So behind a router with
rules the number stands without `@`: what rules say of `setpoint/**` holds for it, and only a pilot may put there.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from secrets import token_hex
from typing import Any, Final

import zenoh

from mkdaemon.bus.names import key

PLAIN_ROOT: Final = "setpoint"
NEIGHBOURS: Final = {"south": [{"filters": [{"modes": ["client", "peer"]}]}]}
"""Zenoh's `gateway` for the daemon: a peer hears of a subscriber only where it asks for that key, as a client does. By
Zenoh's default it hears of every one, the secret root's too. A router still does, because routes need it."""
SECURED: Final = ("tls/", "quic/")
"""Endpoints that ask for certificates, and so may have access rules."""
_CHUNK_BYTES: Final = 16


def new_setpoint_root(connect: Sequence[str] = ()) -> str:
    """A secret root: `setpoint/@<number>`, or `setpoint/<number>` behind a router with access rules.

    Args:
        connect: endpoints of the routers of the daemon.
    """
    mark = "" if any(endpoint.startswith(SECURED) for endpoint in connect) else "@"
    return f"{PLAIN_ROOT}/{mark}{token_hex(_CHUNK_BYTES)}"


def below(root: str, suffix: str) -> str:
    """The key below a root at which setpoints of a plain suffix are taken.

    Args:
        root: as the answer to `take` tells it.
        suffix: plain, for example `setpoint/stick`.
    """
    return root + suffix.removeprefix(PLAIN_ROOT)


def extend_access(config: zenoh.Config, vehicle: str, root: str, images: Mapping[str, str]) -> None:
    """Make every rule of access control that speaks of setpoints, or of images, speak of the secret keys too.

    No pattern in a file can: a chunk that begins with `@` is matched by itself alone.

    Args:
        config: of the daemon's session.
        vehicle: its name.
        root: of its setpoints.
        images: private keys of cameras by the plain ones.
    """
    rules: list[dict[str, Any]] | None = json.loads(config.get_json("access_control")).get("rules")
    if not rules:
        return
    secrets = {key(vehicle, f"{PLAIN_ROOT}/*"): key(vehicle, f"{root}/**"), **images}
    for rule in rules:
        patterns = list(rule["key_exprs"])
        rule["key_exprs"] += [secret for plain, secret in secrets.items() if _speaks_of(patterns, plain)]
    config.insert_json5("access_control/rules", json.dumps(rules))


def _speaks_of(patterns: Iterable[str], plain: str) -> bool:
    return any(zenoh.KeyExpr(pattern).intersects(zenoh.KeyExpr(plain)) for pattern in patterns)
