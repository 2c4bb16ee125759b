"""Serves one page, or Drake's Meshcat, to the browsers of those who know the address.

A page of somebody else's that is open in the same browser can send requests here too.
They say where they come from (Origin), or arrive under a name that is not this
machine's (Host), and are refused.
"""

import contextlib
import errno
import ipaddress
import socket
import threading
from collections.abc import Callable
from http.client import HTTPException, parse_headers
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from socketserver import BaseServer, StreamRequestHandler, ThreadingTCPServer
from typing import Any, TypeVar
from urllib.parse import urlsplit

from teleop_drake.cli.exit_codes import BadInput

_FIRST_PORT, _NUM_PORTS = 7000, 1000

# What a browser sends at most at a time.
_LONGEST_MESSAGE = 1 << 20


def _IsOwn(request: Any, bound: str) -> bool:
    """Returns whether a request comes from a page of this server."""
    host, origin = request.get("Host", ""), request.get("Origin")
    name = urlsplit(f"//{host}").hostname or ""
    if name not in ("localhost", bound, socket.gethostname()):
        try:  # Nobody can let an address lead elsewhere.
            ipaddress.ip_address(name)
        except ValueError:
            return False
    return origin is None or urlsplit(origin).netloc == host


class _Server(ThreadingHTTPServer):
    """A server that knows its page, and whose port is free as soon as it is closed."""

    daemon_threads = True
    # Else a second server may take a port at which one listens.
    allow_reuse_port = False
    bound = ""
    page = b""


class _Handler(BaseHTTPRequestHandler):
    """Answers with the page."""

    server: _Server

    def do_GET(self) -> None:
        """Sends the page; nothing else is here."""
        if not _IsOwn(self.headers, self.server.bound):
            self.send_error(403)
            return
        is_page = self.path.partition("?")[0] in ("/", "/index.html")
        body = self.server.page if is_page else b"Not found"
        self.send_response(200 if is_page else 404)
        kind = "text/html" if is_page else "text/plain"
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        # The browser has left.
        with contextlib.suppress(ConnectionError):
            self.wfile.write(body)

    def log_message(self, *arguments: Any) -> None:
        """Says nothing."""


_S = TypeVar("_S", bound=BaseServer)


def _Bound(make: Callable[[tuple[str, int]], _S], host: str, port: int | None) -> _S:
    """Returns a server at a port, or else at the first free one from 7000 on."""
    first, count = (_FIRST_PORT, _NUM_PORTS) if port is None else (port, 1)
    for candidate in range(first, first + count):
        try:
            return make((host, candidate))
        except OSError as e:
            if e.errno == errno.EADDRINUSE and port is None:
                continue
            if e.errno in (errno.EADDRINUSE, errno.EACCES):
                raise BadInput(
                    f"--port = {candidate}: must be a free port ({e.strerror})"
                ) from None
            raise BadInput(
                f"--host = {host!r}: must be an address of this machine ({e.strerror})"
            ) from None
    raise BadInput(
        f"--port: must be given, {_FIRST_PORT} to {_FIRST_PORT + _NUM_PORTS - 1} are "
        "in use"
    )


def _Url(host: str, port: int) -> str:
    name = "localhost" if host in ("localhost", "127.0.0.1") else host
    return f"http://{name}:{port}/"


class PageServer:
    """Serves one page until Ctrl-C.

    Its port is taken at once, and is free again after Close().

    Args:
        host: The address that it listens at.
        port: Where; None: the first free one from 7000 on.

    Raises:
        BadInput: If the port is in use, or there is no such address.
    """

    def __init__(self, host: str, port: int | None):
        self._server = _Bound(lambda place: _Server(place, _Handler), host, port)
        self._server.bound = host
        self.url = _Url(host, self._server.server_port)

    def Serve(self, page: str) -> None:
        """Serves a page until Ctrl-C."""
        self._server.page = page.encode("utf-8")
        with contextlib.suppress(KeyboardInterrupt):
            self._server.serve_forever()

    def Close(self) -> None:
        """Frees the port."""
        self._server.server_close()


class _GateServer(ThreadingTCPServer):
    """A server that knows what it stands in front of."""

    daemon_threads = True
    allow_reuse_address = True
    bound = ""
    inner = ("", 0)


class _Gatekeeper(StreamRequestHandler):
    """Passes on what one browser sends, and what it is answered."""

    server: _GateServer
    disable_nagle_algorithm = True

    def handle(self) -> None:
        """Passes on until one side has left."""
        with (
            contextlib.suppress(OSError, HTTPException),
            socket.create_connection(self.server.inner) as inner,
        ):
            inner.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            threading.Thread(target=self._Answer, args=[inner], daemon=True).start()
            while self._PassRequest(inner):
                pass

    def _Answer(self, inner: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := inner.recv(1 << 16):
                self.connection.sendall(data)
            self.connection.shutdown(socket.SHUT_RDWR)

    def _PassRequest(self, inner: socket.socket) -> bool:
        """Passes on a request, or a WebSocket as a whole; returns whether it did."""
        first = self.rfile.readline(_LONGEST_MESSAGE)
        headers = parse_headers(self.rfile)
        if not first or not _IsOwn(headers, self.server.bound):
            self.wfile.write(b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\n\r\n")
            return False
        inner.sendall(first + headers.as_bytes().replace(b"\n", b"\r\n"))
        while "Upgrade" in headers:
            inner.sendall(self._Frame())
        return True

    def _Frame(self) -> bytes:
        """Returns the next frame of a WebSocket, or nothing for an empty message.

        At an empty message Meshcat would end.
        """
        head = self.rfile.read(2)
        if len(head) < 2:
            raise ConnectionError
        size = head[1] & 127
        if size > 125:
            length = self.rfile.read(2 if size == 126 else 8)
            size, head = int.from_bytes(length), head + length
        if size > _LONGEST_MESSAGE:
            raise ConnectionError
        frame = head + self.rfile.read(4 + size)
        is_control = head[0] & 8
        return frame if size > 0 or is_control else b""


class Gate:
    """Lets the browsers of those who know the address reach another server.

    Args:
        inner: Address and port of that server.
        host: The address that browsers use.
        port: Where; None: the first free one from 7000 on.

    Attributes:
        url: Of the page.

    Raises:
        BadInput: If the port is in use, or there is no such address.
    """

    def __init__(self, inner: tuple[str, int], host: str, port: int | None):
        server = _Bound(lambda place: _GateServer(place, _Gatekeeper), host, port)
        server.bound, server.inner = host, inner
        self.url = _Url(host, server.server_address[1])
        threading.Thread(target=server.serve_forever, daemon=True).start()


def PortOf(text: str | None, lowest: int = 1) -> int | None:
    """Returns the port that an option has; None: any.

    Raises:
        BadInput: If it is no port.
    """
    if text is None:
        return None
    if not text.isdecimal() or not lowest <= int(text) <= 65535:
        raise BadInput(
            f"--port = {text!r}: must be a whole number from {lowest} to 65535"
        )
    return int(text)
