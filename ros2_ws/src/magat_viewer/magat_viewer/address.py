# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The address that the page's server listens on."""

import errno
import socket

from magat_node.errors import MagatError

#: The default address, reachable from this machine only, and the first port that is tried.
HOST, PORT = "127.0.0.1", 8300
#: Number of ports that are tried.
_TRIES = 100


class ServerError(MagatError, RuntimeError):
    """The page cannot be served."""


def free_port(host: str = HOST) -> int:
    """A free port for a server that starts later.

    Raises:
        ServerError: no port is free.
    """
    with listen(host, None) as listener:
        return int(listener.getsockname()[1])


def listen(host: str, port: int | None) -> socket.socket:
    """A socket that listens on ``port``, or on the first free port from `PORT` on if it is None.

    Raises:
        ServerError: ``host`` is not an address of this machine, or no port is free.
    """
    ports = range(PORT, PORT + _TRIES) if port is None else [port]
    for number in ports:
        try:
            family, *_, address = socket.getaddrinfo(host, number, type=socket.SOCK_STREAM)[0]
            listener = socket.socket(family, socket.SOCK_STREAM)
        except OSError as error:
            raise ServerError(f"{host} is not an address of this machine ({error}): give another --host") from error
        try:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(address)
            listener.listen()
            return listener
        except OSError as error:
            listener.close()
            if error.errno == errno.EADDRNOTAVAIL:
                raise ServerError(f"{host} is not an address of this machine: give another --host") from error
    taken = f"{ports[0]}" if len(ports) == 1 else f"{ports[0]} to {ports[-1]}"
    raise ServerError(f"the port {taken} is in use at {host}: give another --port")
