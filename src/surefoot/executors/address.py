"""Address: a quick check that a cluster answers at its address, before a library waits for it for minutes."""

from __future__ import annotations

import socket

from surefoot.errors import UserError

ANSWERS_WITHIN = 5.0
"""Time that a cluster has to take a connection [s]."""


def check_reachable(kind: str, address: str) -> None:
    """Check that something listens at an address.

    Args:
        kind: of the cluster, for the message.
        address: HOST:PORT, with or without a protocol in front of it.

    Raises:
        UserError: it is no address, or nothing listens there.
    """
    host, colon, port = address.rpartition("://")[2].rstrip("/").rpartition(":")
    if not (colon and host and port.isdecimal() and int(port) < 2**16):
        raise UserError(f"the address of a {kind} cluster is HOST:PORT, not '{address}'")
    try:
        socket.create_connection((host, int(port)), ANSWERS_WITHIN).close()
    except OSError as error:
        raise UserError(f"there is no {kind} cluster at {address}: {error.strerror or error}") from error
