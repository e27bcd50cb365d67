"""A page on this machine alone: it answers on the loopback address, under a path that nobody else knows, to requests
that name this address as host, and with nothing but its own page and data."""

from __future__ import annotations

import json
import secrets
import sys
import threading
from collections.abc import Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from yarnscale.errors import InputError

LARGEST_REQUEST = 10_000
FAILED = "this change failed; the state before it is kept"
PAGE = "text/html; charset=utf-8"
NONCE = "NONCE"
"""Stands in a page for the number that its scripts and styles bear."""


class LocalPage:
    """Serves a page until it is closed.

    Subclasses say what it has (``content``) and which changes it takes (``answer``).

    port: 0 takes a free one. Raises InputError where the port is taken.
    """

    def __init__(self, *, port: int = 0) -> None:
        self._token = secrets.token_urlsafe(16)
        try:
            self._server = _Server(("127.0.0.1", port), _handler(self))
        except OSError as error:
            raise InputError("--port", expected="a free port", found=f"{port}: {error.strerror}") from None

    @property
    def address(self) -> str:
        """Of the page."""
        return f"http://127.0.0.1:{self._server.server_port}/{self._token}/"

    def serve(self) -> None:
        """Answer until the page is closed."""
        try:
            self._server.serve_forever(poll_interval=0.2)
        finally:
            self._server.server_close()

    def close(self) -> None:
        """End ``serve``; may be called while a request is answered."""
        threading.Thread(target=self._server.shutdown, daemon=True).start()

    def content(self, name: str) -> tuple[str, bytes] | None:
        """Type and content of what lies under a name, "" the page itself; None where there is nothing."""
        raise NotImplementedError

    def answer(self, name: str, request: Mapping[str, Any]) -> dict[str, Any] | None:
        """Carry out a change; None where there is none of this name, InputError for bad requests."""
        return None


class _Server(ThreadingHTTPServer):
    """A browser that leaves in the middle of an answer is no fault to tell."""

    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Tell of faults."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)


def _handler(page: LocalPage) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        """Requests of the page."""

        server_version, sys_version = "yarnscale", ""

        def do_GET(self) -> None:
            """The page and its data."""
            name = self._name()
            if name is None:
                return
            found = page.content(name)
            if found is None:
                return self.send_error(404)
            kind, content = found
            nonce = secrets.token_urlsafe(12) if kind == PAGE else ""
            self._send(kind, content.replace(f'"{NONCE}"'.encode(), f'"{nonce}"'.encode()), nonce)

        def do_POST(self) -> None:
            """A change."""
            name = self._name()
            if name is None:
                return
            size = self.headers.get("Content-Length", "")
            if self.headers.get_content_type() != "application/json" or not size.isdecimal():
                return self.send_error(415)
            if int(size) > LARGEST_REQUEST:
                return self.send_error(413)
            try:
                request = json.loads(self.rfile.read(int(size)) or b"{}")
            except ValueError:
                return self.send_error(400)
            except RecursionError:
                request = None
            content: dict[str, Any] | None = {"error": FAILED}
            try:
                content = page.answer(name, request) if isinstance(request, dict) else content
            except InputError as error:
                content = {"error": str(error)}
            except Exception:  # numbers that lead nowhere, full disks: the page goes on
                content = {"error": FAILED}
            if content is None:
                return self.send_error(404)
            self._send("application/json", json.dumps(content, allow_nan=False).encode())

        def _name(self) -> str | None:
            """What is asked for below the page's path; others, and pages of other hosts, get an error."""
            hosts = [f"{host}:{page._server.server_port}" for host in ("127.0.0.1", "localhost")]
            origin = self.headers.get("Origin")
            own = origin is None or origin in [f"http://{host}" for host in hosts]
            if self.headers.get("Host") not in hosts or not own:
                return self.send_error(403)
            path, prefix = self.path.partition("?")[0], f"/{page._token}/"
            if not path.startswith(prefix):
                return self.send_error(404)
            return path.removeprefix(prefix)

        def _send(self, kind: str, content: bytes, nonce: str = "") -> None:
            self.send_response(200)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("X-Content-Type-Options", "nosniff")
            self.send_header("Referrer-Policy", "no-referrer")
            if nonce:
                policy = (
                    "default-src 'none'; img-src 'self' data: blob:; connect-src 'self'; frame-ancestors 'none'; "
                    f"script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'"
                )
                self.send_header("Content-Security-Policy", policy)
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, format: str, *args: object) -> None:
            """Nothing: the console is for results."""

    return Handler
