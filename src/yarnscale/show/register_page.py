"""A page on which a user corrects a registration: photographs with the yarns laid over them."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping
from importlib.resources import files
from typing import Any

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.files.registration_json import Session
from yarnscale.show.local_page import PAGE, LocalPage
from yarnscale.swatches.registration.curves import SAMPLES
from yarnscale.swatches.registration.lattice import Lattice
from yarnscale.swatches.registration.registration import Registration


class RegistrationPage(LocalPage):
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
        self._lock = threading.Lock()
        super().__init__(port=port)

    def content(self, name: str) -> tuple[str, bytes] | None:
        """The page, its photographs and its state."""
        if name == "":
            return PAGE, files("yarnscale.show").joinpath("templates/register.html").read_bytes()
        if name == "state":
            return "application/json", json.dumps(self.answer(name, {}), allow_nan=False).encode()
        picture = self._photographs.get(name.removesuffix(".png"))
        return None if picture is None else ("image/png", picture)

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
                self.close()
            return described


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
