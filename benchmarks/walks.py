"""Which rooms of the package four small calls enter, and how often a lower room calls a function of a higher one.

Run ``python benchmarks/walks.py``; CONTRIBUTING.md has the numbers. Only Python functions are counted.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import CodeType, FrameType

import numpy as np

import yarnscale as ys
from yarnscale.swatches.measurements import Direction
from yarnscale.swatches.objective import YarnObjective
from yarnscale.swatches.uniform_data import UniformCurve, UniformData
from yarnscale.swatches.yarn_model import yarn_model

LEVELS = (
    "swatches", "homogenize", "laboratory", "homogeneous", "fabric", "cell shell", "drawing", "yarn motion", "numerics",
)  # fmt: skip
"""Rooms from above; those of one level do not know each other."""
LEVEL = {room: number for number, rooms in enumerate(LEVELS) for room in rooms.split()}
PACKAGE = Path(ys.__file__).parent


def room_of(code: CodeType) -> str | None:
    """The room that a function belongs to."""
    path = Path(code.co_filename)
    room = path.relative_to(PACKAGE).parts[0] if path.is_relative_to(PACKAGE) else ""
    return room if room in LEVEL else None


def walk(name: str, call: Callable[[], object]) -> None:
    """Run a call and print its rooms and its calls back up, most frequent first."""
    entered, back, known = set[str](), Counter[str](), dict[CodeType, str | None]()

    def room(frame: FrameType) -> str | None:
        if frame.f_code not in known:
            known[frame.f_code] = room_of(frame.f_code)
        return known[frame.f_code]

    def observe(frame: FrameType, event: str, _: object) -> None:
        if event != "call" or (own := room(frame)) is None:
            return
        entered.add(own)
        caller = frame.f_back
        while caller is not None and room(caller) is None:
            caller = caller.f_back
        if caller is not None and LEVEL[own] < LEVEL[other := room(caller) or own]:
            back[f"{other} → {own}.{frame.f_code.co_name}"] += 1

    sys.setprofile(observe)
    try:
        call()
    finally:
        sys.setprofile(None)
    print(f"{name}: {', '.join(sorted(entered, key=LEVEL.__getitem__))}; back up {back.total()}")
    for entry, count in back.most_common(6):
        print(f"  {count:6} {entry}")


def main() -> None:
    yarn = ys.YarnMaterial.preset("hylc2020-basket")
    pattern = ys.settled(ys.patterns.build("plain"), yarn).pattern
    cell = ys.PeriodicCell(pattern, yarn)
    walk("cell.relax", lambda: cell.relax(ys.ShellStrain(s_x=0.05)))

    cloth = ys.scenes.stretch(ys.read_material("stockinette-wool"), spacing=0.02)
    shell = cloth.body
    walk("a step of cloth", lambda: shell.step(cloth.start, 1 / 30))

    fabric = ys.RodFabric.cut(pattern, yarn, columns=2, rows=2)
    rods = ys.RodScene(fabric, ys.sheet_scenes.hang(fabric.sheet))
    moving, start = rods.body, rods.start
    walk("a step of rods", lambda: moving.step(start, 1 / 240))

    stretch = np.linspace(0.04, 0.2, 5)
    curves = [UniformCurve(d, stretch, 0.4 * stretch, 50.0 * stretch, 0.2) for d in (Direction.WEFT, Direction.WARP)]
    model = yarn_model(ys.patterns.build("stockinette"), 20.0)
    objective = YarnObjective(model, UniformData("made up", tuple(curves)))
    middle = np.full(len(model.names), 0.5)
    walk("an evaluation of an estimate", lambda: objective.evaluate(middle))


if __name__ == "__main__":
    main()
