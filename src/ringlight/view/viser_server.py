"""viser's server, bound by ourselves and answering its own pages only.

viser hands its requests to ``websockets``' server without a place for a check of our own, and takes the next port where
one is in use. So while it starts, the function that it calls is ours: it adds both, and calls the library's.
"""

import contextlib
import functools
import io
import logging
import socket
from collections.abc import Iterator
from http import HTTPStatus
from importlib import import_module
from typing import Any

from ringlight.errors import BackendError, RunError
from ringlight.view.same_host import refusal

BACKLOG = 32
"""Connections that may wait: a browser opens a few at once."""


def viser_library() -> Any:
    """The module. Raises BackendError where it is not installed."""
    try:
        import viser
        import websockets.asyncio.server  # noqa: F401
    except ImportError:
        raise BackendError(
            "the viewer needs a library that is not installed; run: pip install 'ringlight[view]'"
        ) from None
    return viser


OWN_NAMES = {"": "127.0.0.1", "0.0.0.0": "127.0.0.1", "::": "::1"}
"""Of this machine, where a server listens at all of its addresses: not every browser opens these."""


def check_address(host: str, port: int) -> None:
    """For those who work long before they listen. Raises RunError where a server could not listen now."""
    _bound(host, port).close()


def start_server(host: str, port: int) -> tuple[Any, str]:
    """A running server and its address, for a browser. Port 0 is any that is free.

    Raises RunError for an address or a port that cannot be had, BackendError where requests of others could not be
    refused.
    """
    viser = viser_library()
    # A browser that closes in the middle is no error; viser's library would print a traceback.
    logging.getLogger("websockets").setLevel(logging.CRITICAL)
    bound = _bound(host, port)
    number = bound.getsockname()[1]
    guarded = _Guard(bound, host)
    with _silent(), guarded.in_place():
        server = viser.ViserServer(host=host, port=number, label="ringlight", verbose=False)
    if not guarded.was_used:
        stop_server(server)
        raise BackendError(
            "this version of viser starts its server otherwise; install the one that constraints.txt names"
        )
    name = OWN_NAMES.get(host, host)
    return server, f"http://{f'[{name}]' if ':' in name else name}:{number}"


def stop_server(server: Any) -> None:
    """End it; browsers see that the connection is gone."""
    with _silent():
        server.stop()


def _bound(host: str, port: int) -> socket.socket:
    """A socket that listens. Raises RunError."""
    if not 0 <= port <= 65535:
        raise RunError(f"--port is {port}; give 1 to 65535, or 0 for any that is free")
    try:
        found = socket.getaddrinfo(host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        family, kind, protocol, _, address = found[0]
        listening = socket.socket(family, kind, protocol)
        try:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listening.bind(address)
            listening.listen(BACKLOG)
        except OSError:
            listening.close()
            raise
    except (OSError, UnicodeError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise RunError(
            f"no viewer can listen at {host}, port {port} ({reason}); give another --port, 0 for any that is free, or "
            "another --host"
        ) from None
    return listening


class _Guard:
    """Stands in for the library's function while a server starts."""

    def __init__(self, listening: socket.socket, host: str):
        self.listening, self.host = listening, host
        self.was_used = False

    @contextlib.contextmanager
    def in_place(self) -> Iterator[None]:
        library: Any = import_module("websockets.asyncio.server")

        served = library.serve

        def serve(handler: Any, host: Any, port: Any, *, process_request: Any, **others: Any) -> Any:
            self.was_used = True
            checked = functools.partial(self.answer, process_request)
            return served(handler, sock=self.listening, process_request=checked, **others)

        library.serve = serve
        try:
            yield
        finally:
            library.serve = served

    def answer(self, then: Any, connection: Any, request: Any) -> Any:
        """What viser answers, or why it is not asked."""
        headers = request.headers
        reason = refusal(headers.get_all("Host"), headers.get_all("Origin"), self.host)
        if reason is not None:
            return connection.respond(HTTPStatus.FORBIDDEN, f"{reason}\n")
        return then(connection, request)


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """viser prints its address, which the commands say in their own way, and that it has ended."""
    with contextlib.redirect_stdout(io.StringIO()):
        yield
