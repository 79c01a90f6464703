"""Access control of the page: accept connections that have the token, or, without a token, those from this machine.

viser has no access control, and any page in the user's browser could connect to a port of the same machine. So viser listens on a port of
its own, on this machine only, and connections reach it through this gate, which reads the head of the first request of each.
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
LARGEST_HEAD = 2**14  # bytes of a request's head
PATIENCE = 10.0  # s for the head to come
BLOCK = 2**16  # bytes passed on at a time


class Answer(Enum):
    """What happens to a request."""

    ADMIT = "passed on to the page"
    REMEMBER = "sent to the page with a cookie that holds the token"
    REFUSE = "refused"


@dataclass(frozen=True)
class Request:
    """The head of an HTTP request. headers: by their names in lower case."""

    target: str
    headers: dict[str, str]

    @classmethod
    def parse(cls, head: bytes) -> Request:
        """Read the head of a request. Raises TtError for what is none."""
        lines = head.decode("latin-1").split("\r\n")
        words = lines[0].split(" ")
        if len(words) != 3 or not words[2].startswith("HTTP/1."):
            raise TtError(f"{lines[0][:80]!r} is no request line of HTTP")
        pairs = (line.partition(":") for line in lines[1:] if line)
        return cls(words[1], {name.strip().lower(): value.strip() for name, _, value in pairs})

    @property
    def is_websocket(self) -> bool:
        """Whether it opens a WebSocket."""
        return self.headers.get("upgrade", "").lower() == "websocket"

    @property
    def tokens(self) -> list[str]:
        """The tokens in the address."""
        return parse_qs(urlsplit(self.target).query).get("token", [])

    @property
    def cookie(self) -> str:
        """The token in the cookie, or ""."""
        try:
            cookies = SimpleCookie(self.headers.get("cookie", ""))
        except CookieError:
            return ""
        return cookies[COOKIE].value if COOKIE in cookies else ""


def is_loopback(host: str) -> bool:
    """Tell whether an address or a name means this machine."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def judge(request: Request, token: str) -> Answer:
    """Decide about a request.

    A WebSocket must come from the page itself: its origin is the host that it is sent to. Without a token, the host must be a name of this
    machine, so that no foreign name that resolves to it is accepted.

    Args:
        request: Its head.
        token: What is demanded; empty: nothing.
    """
    host, origin = request.headers.get("host", ""), request.headers.get("origin")
    if request.is_websocket and origin is not None and urlsplit(origin).netloc != host:
        return Answer.REFUSE
    if not token:
        return Answer.ADMIT if is_loopback(urlsplit(f"//{host}").hostname or "") else Answer.REFUSE
    if any(hmac.compare_digest(given.encode(), token.encode()) for given in request.tokens):
        return Answer.ADMIT if request.is_websocket else Answer.REMEMBER
    return Answer.ADMIT if hmac.compare_digest(request.cookie.encode(), token.encode()) else Answer.REFUSE


class Gate:
    """Holds an address from the start, passes connections on after `open`, and ends with `close`.

    Attributes:
        port: On which it listens.
        watchers: How many pages are open.
    """

    def __init__(self, host: str, port: int, token: str) -> None:
        """Take an address.

        Args:
            host: Address or name of this machine.
            port: 0: any that is free.
            token: What is demanded; empty: nothing.

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
        """Begin to pass connections on to a port of 127.0.0.1."""
        self._page_port = page_port
        self._thread.start()

    def close(self) -> None:
        """Stop listening and end the thread."""
        self._loop.call_soon_threadsafe(self._server.close)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(1.0)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, asyncio.TimeoutError, TtError):
            head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), PATIENCE)
            request = Request.parse(head)
            answer = judge(request, self._token)
            if answer is Answer.ADMIT:
                self.watchers += request.is_websocket
                try:
                    await self._pass_on(head, reader, writer)
                finally:
                    self.watchers -= request.is_websocket
            else:
                writer.write(self._response(answer))
                await writer.drain()
        writer.close()

    def _response(self, answer: Answer) -> bytes:
        if answer is Answer.REMEMBER:
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
    """Copy bytes until one side ends."""
    with suppress(OSError):
        while block := await source.read(BLOCK):
            target.write(block)
            await target.drain()
    target.close()
