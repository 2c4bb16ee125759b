"""Serves one page to browsers."""

import contextlib
import errno
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from teleop_drake.cli.exit_codes import BadInput

_FIRST_PORT, _NUM_PORTS = 7000, 1000


class _Server(ThreadingHTTPServer):
    """A server that knows its page, and whose port is free as soon as it is closed."""

    daemon_threads = True
    # Else a second server may take a port at which one listens.
    allow_reuse_port = False
    page = b""


class _Handler(BaseHTTPRequestHandler):
    """Answers with the page."""

    server: _Server

    def do_GET(self) -> None:
        """Sends the page; nothing else is here."""
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
        first, count = (_FIRST_PORT, _NUM_PORTS) if port is None else (port, 1)
        for candidate in range(first, first + count):
            try:
                self._server = _Server((host, candidate), _Handler)
                break
            except OSError as e:
                if e.errno == errno.EADDRINUSE and port is None:
                    continue
                if e.errno in (errno.EADDRINUSE, errno.EACCES):
                    raise BadInput(
                        f"--port = {candidate}: must be a free port ({e.strerror})"
                    ) from None
                raise BadInput(
                    f"--host = {host!r}: must be an address of this machine "
                    f"({e.strerror})"
                ) from None
        else:
            raise BadInput(
                f"--port: must be given, {_FIRST_PORT} to "
                f"{_FIRST_PORT + _NUM_PORTS - 1} are in use"
            )
        name = "localhost" if host in ("localhost", "127.0.0.1") else host
        self.url = f"http://{name}:{self._server.server_port}/"

    def Serve(self, page: str) -> None:
        """Serves a page until Ctrl-C.

        Args:
            page: HTML.
        """
        self._server.page = page.encode("utf-8")
        with contextlib.suppress(KeyboardInterrupt):
            self._server.serve_forever()

    def Close(self) -> None:
        """Frees the port."""
        self._server.server_close()


def PortOf(text: str | None, lowest: int = 1) -> int | None:
    """Returns the port that an option has; None: any.

    Args:
        text: What was given.
        lowest: The lowest that is allowed.

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
