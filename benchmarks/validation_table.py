"""What benchmarks/validation.py has kept, read again and compared: a table like HYLC20's Table 2, with errors."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from validation_shapes import Difference, Shape, difference, shape_of

from yarnscale.files.cloth_frames import frame_paths

Array = NDArray[np.float64]
FRAME = 1 / 30


@dataclass(frozen=True, eq=False)
class Kept:
    """A case that was begun: what was asked for, how it ended (None: it has not), and its frames."""

    folder: Path
    case: dict
    outcome: dict | None

    @classmethod
    def of(cls, folder: Path) -> Kept:
        outcome = folder / "outcome.json"
        return cls(
            folder,
            json.loads((folder / "case.json").read_text()),
            json.loads(outcome.read_text()) if outcome.exists() else None,
        )

    @cached_property
    def paths(self) -> list[Path]:
        return list(frame_paths(self.folder).values())

    def values(self, name: str) -> Array:
        """One quantity of every frame."""
        found = []
        for path in self.paths:
            with np.load(path) as frame:
                found.append(frame[name])
        return np.array(found)

    @cached_property
    def end(self) -> dict[str, Array]:
        """Arrays of the last frame."""
        with np.load(self.paths[-1]) as frame:
            return dict(frame)

    @property
    def shape(self) -> Shape:
        return shape_of(self.end["surface"], self.case["edge"], self.case["axis"])

    @property
    def seconds(self) -> tuple[float, float]:
        """Processor seconds a step and a frame of 1/30 s."""
        seconds, steps, span = (float(self.end[name]) for name in ("seconds", "steps", "time"))
        return seconds / max(steps, 1.0), seconds / max(span / FRAME, 1e-9)

    @property
    def creep(self) -> float:
        """Change of the force in the last 0.1 s, over the force."""
        times, pulls = self.values("time"), self.values("pull")
        return float(pulls[-1] / np.interp(times[-1] - 0.1, times, pulls) - 1.0)


def kept_runs(out: Path) -> list[Kept]:
    """All cases of a folder."""
    return [Kept.of(path.parent) for path in sorted(out.glob("*/*/case.json"))]


def pairs(runs: list[Kept]) -> list[tuple[Kept, Kept | None]]:
    """Every run of yarns with cloth of the finest mesh: without friction, and with the same where that is kept."""
    found = []
    for run in runs:
        if run.case["spacing"] is not None:
            continue
        same = ("pattern", "scene", "direction", "size")
        cloths = [r for r in runs if r.case["spacing"] and all(r.case[k] == run.case[k] for k in same)]
        finest = [
            min(kept, key=lambda r: r.case["spacing"])
            for friction in (None, run.case["friction"])
            if (kept := [r for r in cloths if r.case["friction"] == friction])
        ]
        found += [(run, cloth) for cloth in finest or [None]]
    return found


def differences(yarns: Kept, cloth: Kept) -> tuple[Difference, Difference]:
    """Of both middle surfaces at the end, seen from above and from the side."""
    surfaces = yarns.end["surface"], cloth.end["surface"]
    return difference(*surfaces, "top"), difference(*surfaces, "side")


def _both(one: float, other: float, unit: float = 1.0, *, relative: bool = True) -> str:
    text = f"{unit * one:.3g} / {unit * other:.3g}"
    return f"{text} ({100.0 * (other / one - 1.0):+.0f} %)" if relative and one else text


def _speeds(yarns: Kept, cloth: Kept | None) -> list[str]:
    cells = ["", "", "", ""]
    if cloth is not None:
        step, frame = cloth.seconds
        cells = [
            f"{1e3 * cloth.case['time_step']:.3g}",
            f"{step:.2g}",
            f"{frame:.2g}",
            f"{cloth.case['vertices']}",
        ]
    step, frame = yarns.seconds
    ratio = f" (×{frame / cloth.seconds[1]:.1f})" if cloth is not None else ""
    more = [
        f"{1e3 * yarns.case['time_step']:.3g}",
        f"{step:.2g}",
        f"{frame:.2g}{ratio}",
        f"{yarns.case['vertices']}",
    ]
    return cells + more


def _errors(yarns: Kept, cloth: Kept | None) -> list[str]:
    unfinished = [
        f"{who} at {float(run.end['time']):.2f} of {run.case['duration']:.2f} s"
        for who, run in (("yarns", yarns), ("cloth", cloth))
        if run is not None and run.outcome is None
    ]
    if cloth is None or unfinished:
        return [", ".join(unfinished) or "no cloth", *[""] * 6]
    one, other = yarns.shape, cloth.shape
    top, side = differences(yarns, cloth)
    notes = [f"{int(yarns.end['faults'])} passages"] * bool(yarns.end["faults"])
    notes += [f"{int(cloth.end['faults'])} frames of cloth cross"] * bool(cloth.end["faults"])
    if yarns.case["scene"] == "drape":
        pulled = ["", "", "", _both(one.lowest, other.lowest, 1e3)]
    else:
        notes.append(f"creeps {100 * yarns.creep:+.1f}, {100 * cloth.creep:+.1f} %")
        pulled = [
            _both(float(yarns.end["pull"]), float(cloth.end["pull"])),
            f"{_both(one.along, other.along, relative=False)}, {_both(one.across, other.across, relative=False)}",
            _both(one.width, other.width, 1e3), _both(one.rise, other.rise, 1e3),
        ]  # fmt: skip
    return [*pulled, f"{top.overlap:.2f}, {side.overlap:.2f}", f"{1e3 * top.outline:.1f}", "; ".join(notes)]


HEAD = (
    "pattern", "scene", "size [cm], periods", "friction", "cloth: Δt [ms]", "s/step", "s/frame", "vertices",
    "yarns: Δt [ms]", "s/step", "s/frame", "vertices", "force [N]", "stretch along, across", "width [mm]",
    "rise, lowest [mm]", "overlap: top, side", "outline [mm]", "notes",
)  # fmt: skip
"""Values of both are yarns / cloth (error of the cloth)."""


def printed(out: Path) -> str:
    """The table of all that a folder keeps."""
    lines = ["| " + " | ".join(HEAD) + " |", "|" + "---|" * len(HEAD)]
    for yarns, cloth in pairs(kept_runs(out)):
        case = yarns.case
        size = f"{100 * case['edge']:.1f}, {case['periods'][0]}×{case['periods'][1]}"
        frictions = [case["friction"]] + ([] if cloth is None else [cloth.case["friction"] or 0.0])
        cells = [case["pattern"], f"{case['scene']}, {case['direction']}", size]
        cells.append(" / ".join(f"{friction:g}" for friction in frictions))
        cells += _speeds(yarns, cloth) + _errors(yarns, cloth)
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)
