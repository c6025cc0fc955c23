"""Sources of the messages' layouts; docs/firmware-notes.md, "Sources", explains each."""

from __future__ import annotations

from enum import StrEnum


class Source(StrEnum):
    """Evidence behind a message."""

    FC_RECEIVE = "FlightCtrl `uart.c`, `BearbeiteRxDaten`"
    FC_SEND = "FlightCtrl `uart.c`, `DatenUebertragung`"
    FC_FORK = "fork of FlightCtrl 2.12a, `uart.c`, `BearbeiteRxDaten`"
    NC_RECEIVE = "NaviCtrl `uart1.c`, `UART1_ProcessRxData`"
    NC_SEND = "NaviCtrl `uart1.c`, `UART1_TransmitTxData`"
    TOOLS = "headers of host tools"
    UGCS = "UgCS"
    WIKI = "MikroKopter wiki"
    CHANGE_LOG = "FlightCtrl change log"
    INFERRED = "inferred"
