"""Guard: the checks of who may open the live page and of its browsers' messages, and the limit of their buffers.

Every web page that a browser shows may send requests to servers on the same machine. A request must therefore carry the
token of the address that `surefoot play` prints, name this server as its host, and come from a page of this server.
"""

from __future__ import annotations

import contextlib
import hashlib
import hmac
import http
import http.cookies
import ipaddress
import logging
import secrets
import socket
from collections.abc import Callable, Iterator, Sequence
from typing import Any
from urllib.parse import parse_qs, urlsplit

import websockets.asyncio.server as websocket_server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from surefoot.errors import UserError
from surefoot.viewer.wire import is_heard

_THIS_MACHINE = ("127.0.0.1", "localhost", "::1")
_EVERYWHERE = ("0.0.0.0", "::", "")
_MAX_MESSAGE_BYTES = 2**16
"""A browser's largest message has some hundred bytes."""
_QUEUE_BYTES = 2**16
"""The system's buffer for a browser that reads more slowly than the page sends: some dozen pictures.

By default it keeps megabytes. A viewer on a slow line would then see old pictures and be taken for gone, because its
answers to the server's pings wait behind them.
"""
_FOR_BROWSERS = {
    "Content-Security-Policy": "frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
"""The page is shown in no other page's frame, and its address is told to nobody."""

_Answer = Callable[[ServerConnection, Request], Response | None]


class Guard:
    """Admits requests with the token, to a name of this server, from a page of this server.

    Args:
        host: name or address on which the server listens.
        names: further names by which browsers reach it.

    Attributes:
        token: token that an address must have.
        num_refused: number of browsers' messages that were refused.
    """

    def __init__(self, host: str, names: Sequence[str] = ()):
        self.token = secrets.token_urlsafe(18)
        self.num_refused = 0
        self._cookie = "surefoot-" + hashlib.sha256(self.token.encode()).hexdigest()[:8]
        self._is_everywhere = host in _EVERYWHERE
        own = () if host in _THIS_MACHINE else (socket.gethostname(),)
        self._names = {name.lower() for name in (*_THIS_MACHINE, host, *own, *names) if name}
        self._is_installed = False

    def refusal(self, request: Request) -> str:
        """Why a request is refused; empty if it is not."""
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        if len(hosts) != 1 or not self._is_ours(hosts[0]):
            return "this server has another name; name it by: surefoot play --host ADDRESS NAME"
        is_websocket = "Upgrade" in request.headers
        if (origins or is_websocket) and not (len(origins) == 1 and _is_page_of(hosts[0], origins[0])):
            return "only the page itself may talk to this server"
        if not self._has_token(request):
            return "open the page by the address that surefoot play prints"
        return ""

    @contextlib.contextmanager
    def installed(self) -> Iterator[None]:
        """Guard the server that viser starts in this block.

        viser has no hook for it. It calls `websockets.asyncio.server.serve`, which has one. This is the only place that
        depends on it.

        Raises:
            UserError: viser has started its server in another way, which nothing guards.
        """
        serve = websocket_server.serve
        websocket_server.serve = self._guarded(serve)  # type: ignore[misc, assignment] # a function in place of a class
        try:
            yield
        finally:
            websocket_server.serve = serve  # type: ignore[misc]
        if not self._is_installed:
            raise UserError("this version of viser cannot be guarded; try: pip install 'viser>=1.1.1,<2'")

    def _guarded(self, serve: Callable[..., Any]) -> Callable[..., Any]:
        guard = self

        class Connection(ServerConnection):
            def connection_made(self, transport: Any) -> None:
                transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _QUEUE_BYTES)
                super().connection_made(transport)

            async def recv(self, decode: bool | None = None) -> Any:
                while not is_heard(data := await super().recv(decode)):
                    guard.num_refused += 1
                return data

        def guarded(*arguments: Any, process_request: _Answer, **options: Any) -> Any:
            guard._is_installed = True
            options |= {"max_size": _MAX_MESSAGE_BYTES, "create_connection": Connection, "logger": _silent_logger()}
            return serve(*arguments, process_request=guard._checked(process_request), **options)

        return guarded

    def _checked(self, answer: _Answer) -> _Answer:
        def checked(connection: ServerConnection, request: Request) -> Response | None:
            refusal = self.refusal(request)
            if refusal:
                return connection.respond(http.HTTPStatus.FORBIDDEN, refusal + "\n")
            response = answer(connection, request)
            if response is not None:
                for name, value in _FOR_BROWSERS.items():
                    response.headers[name] = value
                # The websocket and a reload carry it, since viser's client drops what stands behind the "?".
                response.headers["Set-Cookie"] = f"{self._cookie}={self.token}; Path=/; HttpOnly; SameSite=Strict"
            return response

        return checked

    def _is_ours(self, host: str) -> bool:
        try:
            name = urlsplit(f"//{host}").hostname or ""
            if name in self._names:
                return True
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return self._is_everywhere  # by whichever of the machine's addresses

    def _has_token(self, request: Request) -> bool:
        given = parse_qs(urlsplit(request.path).query).get("token", [])
        cookies: http.cookies.SimpleCookie = http.cookies.SimpleCookie()
        with contextlib.suppress(http.cookies.CookieError):
            cookies.load("; ".join(request.headers.get_all("Cookie")))
        given += [cookies[self._cookie].value] if self._cookie in cookies else []
        return any(hmac.compare_digest(token.encode(), self.token.encode()) for token in given)


def _is_page_of(host: str, origin: str) -> bool:
    """Does a page of this origin come from the server with this host and port?"""
    scheme, _, place = origin.partition("://")
    return scheme in ("http", "https") and place.lower() == host.lower()


def _silent_logger() -> logging.Logger:
    """For the server: what strangers send does not belong on the terminal."""
    logger = logging.getLogger("surefoot.viewer.server")
    logger.propagate = False
    if not logger.handlers:
        logger.addHandler(logging.NullHandler())
    return logger
