"""Access control of the page: accept connections that have the token or, if no token is demanded, connections from this machine.

viser, which serves the page, has no access control, and any web page in the user's browser could connect to a port of the same machine.
Therefore viser listens on a port of its own, on this machine only. Connections reach it through this gate, which reads the head of the
first request of each connection.
"""

from __future__ import annotations

import asyncio
import hmac
import ipaddress
import threading
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlsplit

from tt_core.errors import TtError

COOKIE = "view_token"
LARGEST_HEAD = 2**14  # bytes, largest head of a request
HEAD_TIMEOUT = 10.0  # s, longest wait for the head of a request
BLOCK = 2**16  # bytes that are passed on at a time


class Decision(Enum):
    """What the gate does with a request."""

    ADMIT = "passed on to the page"
    REMEMBER = "sent to the page with a cookie that holds the token"
    REFUSE = "refused"


@dataclass(frozen=True)
class Request:
    """The head of an HTTP request.

    Attributes:
        target: Requested path with query, e.g. "/?token=abc".
        headers: Values of the headers, by their names in lower case.
    """

    target: str
    headers: dict[str, str]

    @classmethod
    def parse(cls, head: bytes) -> Request:
        """Parse the bytes of the head of a request. Raises TtError if they are not the head of an HTTP/1 request."""
        lines = head.decode("latin-1").split("\r\n")
        words = lines[0].split(" ")
        if len(words) != 3 or not words[2].startswith("HTTP/1."):
            raise TtError(f"{lines[0][:80]!r} is no request line of HTTP")
        pairs = (line.partition(":") for line in lines[1:] if line)
        return cls(words[1], {name.strip().lower(): value.strip() for name, _, value in pairs})

    @property
    def is_websocket(self) -> bool:
        """Whether the request opens a WebSocket."""
        return self.headers.get("upgrade", "").lower() == "websocket"

    @property
    def tokens(self) -> list[str]:
        """The values of `token` in the query of the address, usually none or one."""
        return parse_qs(urlsplit(self.target).query).get("token", [])

    @property
    def cookie(self) -> str:
        """The token in the gate's cookie; "" if the request does not have this cookie."""
        try:
            cookies = SimpleCookie(self.headers.get("cookie", ""))
        except CookieError:
            return ""
        return cookies[COOKIE].value if COOKIE in cookies else ""


def is_loopback(host: str) -> bool:
    """Return whether a host is "localhost" or a loopback address, and so means this machine."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def decide(request: Request, token: str) -> Decision:
    """Decide what to do with a request.

    A WebSocket is refused unless it comes from the page itself: the host of its origin must be the host to which it is sent. If no token is
    demanded, this host must be a loopback name, so that a foreign name which resolves to this machine is refused.

    Args:
        request: Head of the request.
        token: The token that is demanded; "" to demand none.
    """
    host, origin = request.headers.get("host", ""), request.headers.get("origin")
    if request.is_websocket and origin is not None and urlsplit(origin).netloc != host:
        return Decision.REFUSE
    if not token:
        return Decision.ADMIT if is_loopback(urlsplit(f"//{host}").hostname or "") else Decision.REFUSE
    if any(hmac.compare_digest(given.encode(), token.encode()) for given in request.tokens):
        return Decision.ADMIT if request.is_websocket else Decision.REMEMBER
    return Decision.ADMIT if hmac.compare_digest(request.cookie.encode(), token.encode()) else Decision.REFUSE


class Gate:
    """Server that passes the accepted connections on to the page. It binds its address when made, serves from `open` on until `close`.

    Attributes:
        port: Port on which it listens.
        watchers: Number of open pages, counted by their WebSockets.
    """

    def __init__(self, host: str, port: int, token: str) -> None:
        """Bind the address, so that no other program can take it.

        Args:
            host: Address or name of this machine on which to listen.
            port: Port; 0 for any that is free.
            token: The token that is demanded; "" to demand none.

        Raises:
            TtError: The address cannot be used.
        """
        self._page_port, self._token, self.watchers = 0, token, 0
        self._loop = asyncio.new_event_loop()
        try:
            self._server = self._loop.run_until_complete(asyncio.start_server(self._serve, host, port, limit=LARGEST_HEAD))
        except OSError as error:
            self._loop.close()
            raise TtError(f"the page cannot be served on {host}, port {port}: {error.strerror or error}") from error
        self.port: int = self._server.sockets[0].getsockname()[1]
        self._thread = threading.Thread(target=self._loop.run_forever, name="gate", daemon=True)

    def open(self, page_port: int) -> None:
        """Begin to serve, and pass accepted connections on to the port `page_port` of 127.0.0.1."""
        self._page_port = page_port
        self._thread.start()

    def close(self) -> None:
        """Stop serving, and end the thread of the server."""
        self._loop.call_soon_threadsafe(self._server.close)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(1.0)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, asyncio.TimeoutError, TtError):
            head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), HEAD_TIMEOUT)
            request = Request.parse(head)
            decision = decide(request, self._token)
            if decision is Decision.ADMIT:
                self.watchers += request.is_websocket
                try:
                    await self._pass_on(head, reader, writer)
                finally:
                    self.watchers -= request.is_websocket
            else:
                writer.write(self._response(decision))
                await writer.drain()
        writer.close()

    def _response(self, decision: Decision) -> bytes:
        if decision is Decision.REMEMBER:
            cookie = f"{COOKIE}={self._token}; HttpOnly; SameSite=Strict; Path=/"
            lines = ["HTTP/1.1 303 See Other", "Location: /", f"Set-Cookie: {cookie}"]
            text = ""
        else:
            lines = ["HTTP/1.1 403 Forbidden", "Content-Type: text/plain"]
            text = "This page needs its token: open the address that the node has printed.\n"
        return "\r\n".join([*lines, f"Content-Length: {len(text)}", "Connection: close", "", text]).encode()

    async def _pass_on(self, head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        page_reader, page_writer = await asyncio.open_connection("127.0.0.1", self._page_port)
        page_writer.write(head)
        await asyncio.gather(_copy(reader, page_writer), _copy(page_reader, writer))


async def _copy(source: asyncio.StreamReader, target: asyncio.StreamWriter) -> None:
    """Copy bytes until one side closes the connection."""
    with suppress(OSError):
        while block := await source.read(BLOCK):
            target.write(block)
            await target.drain()
    target.close()
