"""What is known of a registration while a user works on it: a JSON file beside the pattern, and its earlier states."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from yarnscale.errors import InputError
from yarnscale.files.atomic import write_text
from yarnscale.files.fields import Fields, json_file
from yarnscale.swatches.registration.curves import YarnCurves
from yarnscale.swatches.registration.lattice import Lattice
from yarnscale.swatches.registration.registration import Registration

FORMAT, VERSION = "yarnscale-registration", 1
MOST_STATES = 200
"""Earlier states that are kept for undo."""


@dataclass(frozen=True, eq=False)
class Session:
    """A registration and its earlier states, the last one at the end. inputs: fingerprint of what it was made from."""

    path: Path
    inputs: str
    current: Registration
    earlier: tuple[Registration, ...] = ()

    def changed(self, after: Registration) -> Session:
        """The session with another state, not yet written."""
        return replace(self, current=after, earlier=(*self.earlier, self.current)[-MOST_STATES:])

    def undone(self) -> Session:
        """The session at its state before the last change, not yet written; the same where there is none."""
        if not self.earlier:
            return self
        return replace(self, current=self.earlier[-1], earlier=self.earlier[:-1])

    def saved(self) -> Session:
        """The session, written."""
        curves = self.current.curves
        head = {"format": FORMAT, "version": VERSION, "inputs": self.inputs, "pixel": self.current.pixel}
        head |= {"counts": curves.counts, "shifts": curves.shifts, "radii": curves.radii.tolist()}
        rows = ",\n".join(json.dumps(_plain(state)) for state in (*self.earlier, self.current))
        write_text(self.path, f'{json.dumps(head)[:-1]}, "states": [\n{rows}\n]}}\n')
        return self


def session_path(pattern: Path) -> Path:
    """Where the session of a pattern lies."""
    return pattern.with_suffix(".register.json")


def read_session(path: Path, inputs: str) -> Session | None:
    """The session in a file, None where there is no file; InputError where it is none or of other inputs."""
    if not path.exists():
        return None
    with json_file(path) as document:
        found = document.text("format"), document.integer("version")
        if found != (FORMAT, VERSION):
            raise document.fault("format", expected=f"{FORMAT} {VERSION}", found=f"{found[0]} {found[1]}")
        if document.text("inputs") != inputs:
            expected = "the same pictures, chart, yarns, --scale, --radius and --period, or --overwrite to begin anew"
            raise InputError("state of another registration", where=path, expected=expected)
        states = [_state(document, entry) for entry in document.items("states")]
        if not states:
            raise document.fault("states", expected="one or more", found="none")
    return Session(path, inputs, states[-1], tuple(states[:-1]))


def _plain(state: Registration) -> dict[str, Any]:
    lattices = {
        side: [*lattice.origin.tolist(), *lattice.course.tolist(), *lattice.wale.tolist()]
        for side, lattice in state.lattices.items()
    }
    return {
        "period": state.curves.period.tolist(), "controls": state.curves.controls.tolist(), "lattices": lattices,
        "pins": sorted(state.pins), "explained": dict(state.explained),
        "apart": state.apart,
    }  # fmt: skip


def _state(document: Fields, entry: Fields) -> Registration:
    counts = tuple(document.integers("counts").tolist())
    shifts = document.integers("shifts", shape=(len(counts), 2)).tolist()
    curves = YarnCurves(
        entry.numbers("controls", shape=(sum(counts), 3)), counts, tuple((a, b) for a, b in shifts),
        entry.numbers("period", shape=(2,)), document.numbers("radii", shape=(len(counts),)),
    )  # fmt: skip
    table = entry.fields("lattices")
    lattices = {side: Lattice(*np.split(table.numbers(side, shape=(6,)), 3)) for side in table.content}
    shares = entry.fields("explained")
    explained = {side: shares.number(side) for side in shares.content}
    pins = frozenset(entry.integers("pins").tolist())
    return Registration(
        curves, lattices, document.number("pixel", positive=True), pins, explained, entry.flag_or("apart", False)
    )
