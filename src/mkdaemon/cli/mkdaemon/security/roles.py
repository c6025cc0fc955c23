"""Who may do what over the bus, from one table; and the Zenoh configurations that say so.

The common name of a certificate is the role of its owner, so that a further pilot needs no other rules: those of
a daemon cannot change while it runs. What is not allowed is denied, and a denied `put` is dropped without a word to its
sender: that is why everything that moves the aircraft is a query, which is then seen to have no answer.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from mkdaemon.bus.keys import Use, roots

DAEMON: Final = "daemon"
"""The role of a daemon; a router lets it do everything."""
ROUTER: Final = "router"
"""The role of a router: a daemon permits it what it permits a pilot, because the router has checked the client."""
SERVERS: Final = (DAEMON, ROUTER)
"""Those that clients connect to."""


class AccessRule(NamedTuple):
    """What some messages of some keys may do.

    Attributes:
        id: of the rule.
        flows: `ingress` to the daemon, `egress` from it.
        messages: kinds of Zenoh's messages.
        keys: key expressions.
    """

    id: str
    flows: tuple[str, ...]
    messages: tuple[str, ...]
    keys: tuple[str, ...]


_BOTH: Final = ("ingress", "egress")
_PUBLISHED: Final = (*(f"mk/*/{root}/**" for root in roots(Use.PUBLISHED)), "mk/*/schema/**", "mk/*/alive")
"""A chunk with `@` in front is not matched by `**`; of our keys only the secret ones of setpoints and images have such,
and the daemon adds them to every rule that speaks of the plain ones."""
LOOK: Final = AccessRule("look", ("ingress",), ("query", "liveliness_query"), _PUBLISHED)
HEAR: Final = AccessRule("hear", ("egress",), ("put", "delete", "reply", "liveliness_token"), _PUBLISHED)
"""Only from the daemon: no client may put telemetry or a schema, or declare the daemon's liveliness token."""
FLY: Final = AccessRule(
    "fly",
    _BOTH,
    ("put", "query", "reply", "liveliness_token"),
    # `sim/camera`, `camera`: images that a `zenoh:` source of the daemon takes.
    (
        *("mk/*/cmd/**", "mk/*/do/**", "mk/*/setpoint/**", "mk/*/joy/*", "mk/*/client/*"),
        *("mk/*/sim/camera/*", "mk/*/camera/*"),
    ),
)
MARK: Final = AccessRule("mark", _BOTH, ("query", "reply"), ("mk/*/do/mark",))
REPORT: Final = AccessRule("report", _BOTH, ("put",), ("mk/*/positions/**",))
"""Of a motion capture system, and of whom flies. The daemon adds the secret keys of its sources."""
SUBSCRIBE: Final = AccessRule("subscribe", _BOTH, ("declare_subscriber", "declare_liveliness_subscriber"), ("mk/**",))
"""Rules for `put` decide what a subscriber gets, so every client may subscribe to everything."""
SERVE: Final = AccessRule("serve", ("egress",), ("declare_queryable",), ("mk/**",))
"""Only the daemon answers queries; no client may declare a queryable."""
BE_DAEMON: Final = AccessRule(
    "be-daemon",
    _BOTH,
    (
        *("put", "delete", "query", "reply", "liveliness_token", "liveliness_query"),
        *("declare_subscriber", "declare_liveliness_subscriber", "declare_queryable"),
    ),
    ("mk/**",),
)
"""Of a router alone: what is flown behind it."""
HIDE: Final = AccessRule("hide", ("egress",), ("put",), ("mk/*/setpoint/*/*",))
"""Denied, and only on a router: below the secret number of a daemon, only that daemon may listen."""


class Role(NamedTuple):
    """What holders of a certificate may do.

    Attributes:
        name: common name of their certificates.
        may: what it is for.
        rules: what is allowed to them.
    """

    name: str
    may: str
    rules: tuple[AccessRule, ...]


ROLES: Final = (
    Role("pilot", "fly, command, and everything that the other roles may", (LOOK, HEAR, FLY, REPORT, SUBSCRIBE, SERVE)),
    Role("observer", "look at everything, and neither command nor fly", (LOOK, HEAR, SUBSCRIBE, SERVE)),
    Role(
        "recorder",
        "look at everything and set marks, and neither command nor fly",
        (LOOK, HEAR, MARK, SUBSCRIBE, SERVE),
    ),
    Role(
        "source",
        "look at everything and report positions, and neither command nor fly",
        (LOOK, HEAR, REPORT, SUBSCRIBE, SERVE),
    ),
)
"""Every role of a client."""


_PILOT: Final = ROLES[0]
NEIGHBOURS: Final = {
    DAEMON: (*ROLES, Role(ROUTER, "hand on what clients ask", _PILOT.rules)),
    ROUTER: (
        *(Role(role.name, role.may, (*role.rules, HIDE)) for role in ROLES),
        Role(DAEMON, "be flown", (BE_DAEMON,)),
    ),
}
"""Who is on the other side of a link, by the role of this side."""


def access_control(role: str) -> dict[str, Any]:
    """The access rules of a daemon or of a router, as Zenoh reads them.

    Args:
        role: one of `SERVERS`.
    """
    neighbours = NEIGHBOURS[role]
    rules = {rule.id: rule for neighbour in neighbours for rule in neighbour.rules}
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [
            {
                "id": rule.id,
                "permission": "deny" if rule is HIDE else "allow",
                "flows": list(rule.flows),
                "messages": list(rule.messages),
                "key_exprs": list(rule.keys),
            }
            for rule in rules.values()
        ],
        "subjects": [{"id": one.name, "cert_common_names": [one.name]} for one in neighbours],
        "policies": [{"rules": [rule.id for rule in one.rules], "subjects": [one.name]} for one in neighbours],
    }


def zenoh_file(role: str, tls: Mapping[str, str], about: str) -> str:
    """The Zenoh configuration of a daemon, a router or a client.

    Args:
        role: `daemon`, `router`, or that of a client.
        tls: certificates and keys, as Zenoh calls them.
        about: comment at the top; each line of it becomes one.
    """
    settings = {**tls, "enable_mtls": True, "verify_name_on_connect": True}
    content: dict[str, Any] = {"transport": {"link": {"tls": settings}}}
    if role in SERVERS:
        content["access_control"] = access_control(role)
    head = "".join(f"// {line}\n" for line in about.splitlines())
    return f"{head}{json.dumps(content, indent=2)}\n"
