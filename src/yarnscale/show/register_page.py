"""A page on this machine alone, on which a user corrects a registration: photographs with the yarns laid over them.

It answers on the loopback address, under a path that nobody else knows, to requests that name this address as host.
"""

from __future__ import annotations

import json
import secrets
import threading
from collections.abc import Callable, Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.files.registration_json import Session
from yarnscale.swatches.registration.curves import SAMPLES
from yarnscale.swatches.registration.lattice import Lattice
from yarnscale.swatches.registration.registration import Registration

LARGEST_REQUEST = 10_000
FAILED = "this change failed; the state before it is kept"


class RegistrationPage:
    """Serves a session until its user finishes.

    photographs: PNG by side. pictures: evened brightness by side, for the automatic fit. finish: called at the end with
    the session; an InputError that it raises is shown on the page, which goes on.
    """

    def __init__(
        self,
        session: Session,
        photographs: Mapping[str, bytes],
        pictures: Mapping[str, Array],
        finish: Callable[[Session], object],
        *,
        port: int = 0,
    ) -> None:
        self.session, self._photographs, self._pictures, self._finish = session, photographs, pictures, finish
        self._token, self._lock = secrets.token_urlsafe(16), threading.Lock()
        try:
            self._server = ThreadingHTTPServer(("127.0.0.1", port), self._handler())
        except OSError as error:
            raise InputError("--port", expected="a free port", found=f"{port}: {error.strerror}") from None
        self._server.daemon_threads = True

    @property
    def address(self) -> str:
        """Of the page."""
        return f"http://127.0.0.1:{self._server.server_port}/{self._token}/"

    def serve(self) -> None:
        """Answer until the user finishes."""
        try:
            self._server.serve_forever(poll_interval=0.2)
        finally:
            self._server.server_close()

    def answer(self, name: str, request: Mapping[str, Any]) -> dict[str, Any]:
        """Carry out ``state``, ``move``, ``period``, ``undo``, ``fit`` or ``finish``; InputError for bad requests."""
        with self._lock:
            session, current = self.session, self.session.current
            if name == "move":
                place = _numbers(request, "place", 2)
                session = session.changed(current.moved(_side(current, request), _index(request), place))
            elif name == "period":
                side = _side(current, request)
                lattice = Lattice(*(_numbers(request, key, 2) for key in ("origin", "course", "wale")))
                session = session.changed(current.with_lattice(side, lattice))
            elif name == "undo":
                session = session.undone()
            elif name == "fit":
                session = session.changed(current.fitted(self._pictures))
            elif name not in ("state", "finish"):
                raise InputError("request", expected="move, period, undo, fit or finish", found=name)
            # Only what the page can draw is kept.
            described = _described(session)
            json.dumps(described, allow_nan=False)
            if session is not self.session:
                self.session = session.saved()
            if name == "finish":
                self._finish(session)
                threading.Thread(target=self._server.shutdown, daemon=True).start()
            return described

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        page = self

        class Handler(BaseHTTPRequestHandler):
            """Requests of the page."""

            server_version, sys_version = "yarnscale", ""

            def do_GET(self) -> None:
                """The page, its photographs and its state."""
                name = self._name()
                if name is None:
                    return
                if name == "":
                    source = files("yarnscale.show").joinpath("templates/register.html").read_text("utf-8")
                    nonce = secrets.token_urlsafe(12)
                    self._send("text/html; charset=utf-8", source.replace("NONCE", nonce).encode(), nonce)
                elif name.removesuffix(".png") in page._photographs:
                    self._send("image/png", page._photographs[name.removesuffix(".png")])
                elif name == "state":
                    self._answer(name, {})
                else:
                    self.send_error(404)

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
                if not isinstance(request, dict):
                    return self._send("application/json", json.dumps({"error": FAILED}).encode())
                self._answer(name, request)

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

            def _answer(self, name: str, request: Mapping[str, Any]) -> None:
                try:
                    content = page.answer(name, request)
                except InputError as error:
                    content = {"error": str(error)}
                except Exception:  # numbers that lead nowhere, full disks: the page goes on
                    content = {"error": FAILED}
                self._send("application/json", json.dumps(content, allow_nan=False).encode())

            def _send(self, kind: str, content: bytes, nonce: str = "") -> None:
                self.send_response(200)
                self.send_header("Content-Type", kind)
                self.send_header("Content-Length", str(len(content)))
                self.send_header("Cache-Control", "no-store")
                self.send_header("X-Content-Type-Options", "nosniff")
                self.send_header("Referrer-Policy", "no-referrer")
                if nonce:
                    policy = (
                        "default-src 'none'; img-src 'self'; connect-src 'self'; frame-ancestors 'none'; "
                        f"script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'"
                    )
                    self.send_header("Content-Security-Policy", policy)
                self.end_headers()
                self.wfile.write(content)

            def log_message(self, format: str, *args: object) -> None:
                """Nothing: the console is for results."""

        return Handler


def _side(current: Registration, request: Mapping[str, Any]) -> str:
    side = request.get("side")
    if not isinstance(side, str) or side not in current.lattices:
        raise InputError("side", expected=" or ".join(current.lattices), found=repr(side)[:60])
    return side


def _index(request: Mapping[str, Any]) -> int:
    point = request.get("point")
    if isinstance(point, bool) or not isinstance(point, int):
        raise InputError("point", expected="a number of a control point", found=repr(point))
    return point


def _numbers(request: Mapping[str, Any], key: str, count: int) -> Array:
    values = request.get(key)
    if not isinstance(values, list) or len(values) != count:
        values = [None]
    if not all(isinstance(v, (int, float)) and abs(v) < 1e6 for v in values):
        raise InputError(key, expected=f"{count} numbers", found=repr(request.get(key))[:60])
    return np.array(values, dtype=np.float64)


def _described(session: Session) -> dict[str, Any]:
    """What the page draws: by side the lattice, and in its pixels samples, which are seen, and control points."""
    state = session.current
    curves = state.curves
    period = 1e3 * curves.period
    sides = {}
    for side, lattice in state.lattices.items():
        sides[side] = {
            "origin": lattice.origin.tolist(), "course": lattice.course.tolist(), "wale": lattice.wale.tolist(),
            "samples": lattice.pixels(curves.samples[:, :2] / curves.period).round(2).tolist(),
            "controls": lattice.pixels(curves.controls[:, :2] / curves.period).round(2).tolist(),
            "seen": state.seen(side).astype(int).tolist(),
            "radius": float(curves.radius / curves.period[0] * np.linalg.norm(lattice.course)),
        }  # fmt: skip
    return {
        "sides": sides, "counts": list(curves.counts), "shifts": [list(shift) for shift in curves.shifts],
        "samples": SAMPLES, "pins": sorted(state.pins), "explained": dict(state.explained),
        "period": period.tolist(), "radius": 1e3 * curves.radius, "undo": len(session.earlier),
    }  # fmt: skip
