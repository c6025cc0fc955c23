"""Who may do what over the bus, from one table; and the Zenoh configurations that say so.

The common name of a certificate is the role of whoever shows it, so that a further pilot needs no other rules: those of
a daemon cannot change while it runs. What is not allowed is denied, and a denied `put` is dropped without a word to its
sender: that is why everything that moves the aircraft is a query, which is then seen to have no answer.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from mkdaemon.bus.keys import Use, roots

DAEMON: Final = "daemon"
"""The role of a daemon, which is under no rule."""


class Rule(NamedTuple):
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
LOOK: Final = Rule("look", ("ingress",), ("query", "liveliness_query"), _PUBLISHED)
HEAR: Final = Rule("hear", ("egress",), ("put", "delete", "reply", "liveliness_token"), _PUBLISHED)
"""Out of the daemon alone: nobody may put telemetry or a schema, or show the token of its life."""
FLY: Final = Rule(
    "fly",
    _BOTH,
    ("put", "query", "reply", "liveliness_token"),
    # `sim/camera`, `camera`: images that a `zenoh:` source of the daemon takes.
    (
        *("mk/*/cmd/**", "mk/*/do/**", "mk/*/setpoint/**", "mk/*/joy/*", "mk/*/client/*"),
        *("mk/*/sim/camera/*", "mk/*/camera/*"),
    ),
)
MARK: Final = Rule("mark", _BOTH, ("query", "reply"), ("mk/*/do/mark",))
SUBSCRIBE: Final = Rule("subscribe", _BOTH, ("declare_subscriber", "declare_liveliness_subscriber"), ("mk/**",))
"""What may be put decides what a subscriber hears, so everybody may subscribe to everything."""
SERVE: Final = Rule("serve", ("egress",), ("declare_queryable",), ("mk/**",))
"""Only the daemon answers queries: nobody else may claim to."""


class Role(NamedTuple):
    """What holders of a certificate may do.

    Attributes:
        name: common name of their certificates.
        may: what it is for.
        rules: what is allowed to them.
    """

    name: str
    may: str
    rules: tuple[Rule, ...]


ROLES: Final = (
    Role("pilot", "fly, command, and all that the others may", (LOOK, HEAR, FLY, SUBSCRIBE, SERVE)),
    Role("observer", "look at everything, and neither command nor fly", (LOOK, HEAR, SUBSCRIBE, SERVE)),
    Role(
        "recorder",
        "look at everything and set marks, and neither command nor fly",
        (LOOK, HEAR, MARK, SUBSCRIBE, SERVE),
    ),
)
"""Every role of a client."""


def access_control() -> dict[str, Any]:
    """The access rules of a daemon, as Zenoh reads them."""
    rules = {rule.id: rule for role in ROLES for rule in role.rules}
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [
            {
                "id": rule.id,
                "permission": "allow",
                "flows": list(rule.flows),
                "messages": list(rule.messages),
                "key_exprs": list(rule.keys),
            }
            for rule in rules.values()
        ],
        "subjects": [{"id": role.name, "cert_common_names": [role.name]} for role in ROLES],
        "policies": [{"rules": [rule.id for rule in role.rules], "subjects": [role.name]} for role in ROLES],
    }


def zenoh_file(role: str, tls: Mapping[str, str], about: str) -> str:
    """The Zenoh configuration of a daemon or a client.

    Args:
        role: `daemon`, or that of a client.
        tls: certificates and keys, as Zenoh calls them.
        about: comment at the top; each line of it becomes one.
    """
    settings = {**tls, "enable_mtls": True, "verify_name_on_connect": True}
    content: dict[str, Any] = {"transport": {"link": {"tls": settings}}}
    if role == DAEMON:
        content["access_control"] = access_control()
    head = "".join(f"// {line}\n" for line in about.splitlines())
    return f"{head}{json.dumps(content, indent=2)}\n"
