"""Where the page is to be found: the address that its server listens on."""

import errno
import socket

from magat_node.errors import MagatError

#: This machine only, and the first port that is tried.
HOST, PORT = "127.0.0.1", 8300
#: Ports that are tried, from the first one on.
_TRIES = 100


class ServerError(MagatError, RuntimeError):
    """The page cannot be served; the message says why and what to do."""


def free_port(host: str = HOST) -> int:
    """A port for a server that is started in a moment.

    Raises:
        ServerError: none is free.
    """
    with listen(host, None) as listener:
        return int(listener.getsockname()[1])


def listen(host: str, port: int | None) -> socket.socket:
    """A socket that listens on ``port``, or on the first free one from `PORT` on if that is None.

    Raises:
        ServerError: the address is not this machine's, or no port is free.
    """
    ports = range(PORT, PORT + _TRIES) if port is None else [port]
    for number in ports:
        try:
            family, *_, address = socket.getaddrinfo(host, number, type=socket.SOCK_STREAM)[0]
            listener = socket.socket(family, socket.SOCK_STREAM)
        except OSError as error:
            raise ServerError(f"{host} is no address of this machine ({error}): give --host another one") from error
        try:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(address)
            listener.listen()
            return listener
        except OSError as error:
            listener.close()
            if error.errno == errno.EADDRNOTAVAIL:
                raise ServerError(f"{host} is no address of this machine: give --host another one") from error
    taken = f"{ports[0]}" if len(ports) == 1 else f"{ports[0]} to {ports[-1]}"
    raise ServerError(f"the port {taken} is taken at {host}: choose another one by --port")
