"""One vehicle, as a program sees it through its daemon."""

from __future__ import annotations

from mkdaemon.client.lease import Leasing
from mkdaemon.client.navi import NaviModes
from mkdaemon.client.requests import Requests
from mkdaemon.client.settings import SettingsProcedures
from mkdaemon.client.summary import Summary
from mkdaemon.client.verbs import Verbs


class Vehicle(Summary, Leasing, Verbs, Requests, SettingsProcedures, NaviModes):
    """A vehicle whose daemon this program is connected to; made by `connect`."""
