"""A bag: a ball swings through a sheet held at its rim, yarn by yarn and as cloth; how much of it stays.

python benchmarks/friction_paths.py --fit 0.2 stockinette-wool
python benchmarks/bag.py stockinette-wool --picture bag.png

The scene ``simulate bagging``, smaller, of a fabric of the library, in a folder of its name with friction fitted to its
cell; once with the friction of the fit and once without any. The sheet first comes to rest under gravity, then the ball
swings, then it comes to rest again. A depth is that of what lay at a place at the start below where it lay then.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from yarnscale.arrays import Array
from yarnscale.fabric.fabric_scene import USUAL_STEP
from yarnscale.fabric.rod_fabric import RodFabric
from yarnscale.fabric.rod_scene import RodScene
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.fabric.sheet_scene import SheetScene
from yarnscale.files import material_library
from yarnscale.files.animation import Animation, Moment, Surface
from yarnscale.files.material_json import read_material
from yarnscale.files.patterns import read_pattern, read_yarns
from yarnscale.kinematics import GRAVITY
from yarnscale.motion.body import Body
from yarnscale.motion.handles import Handle
from yarnscale.motion.obstacles import Sphere
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import FRAME, Schedule
from yarnscale.shell.materials.compact import CompactMaterial
from yarnscale.shell.mesh import rectangle
from yarnscale.shell.scenes.sheet_scenes import bagging
from yarnscale.shell.state import ClothState
from yarnscale.show.curves import Curve
from yarnscale.show.run_page import frames_picture
from yarnscale.show.tubes import yarn_picture

RIM = 0.0045
"""Width of the rim of yarns that is held [m]."""
HANG, SWUNG = 0.3, 0.8
"""Dynamics before the sheet comes to rest, and of the ball [s]."""
LATER = 1000.0
"""When the ball begins to swing [s]: no way to rest takes so long."""
DAMPING, BALL_FRICTION = 5.0, 0.2
NEAR = 0.1
"""Half-width of the strip of a profile, and of its middle, of the size of the sheet."""


@dataclass(frozen=True, eq=False)
class Bag:
    """Depth along x of the strip through the middle, at rest before the ball, at its deepest, and at rest after it.

    places: (k,) [m]; depths: (3, k) [m]. shape: points at the end (n, 3) [m], of the triangles or yarns of ``subject``.
    """

    name: str
    places: Array
    depths: Array
    shape: Array
    subject: Surface | YarnSheet


def main() -> None:
    """Print a table of Markdown; draw both fabrics after the ball, and profiles."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="of friction_paths.py --fit, called as a fabric of the library")
    parser.add_argument("--size", type=float, default=0.06, help="of the sheet inside its rim [m]")
    parser.add_argument("--spacing", type=float, default=0.003, help="of cloth [m]")
    parser.add_argument("--picture", type=Path, help="PNG file")
    options = parser.parse_args()
    material = read_material(options.folder / "material.json")
    assert isinstance(material, CompactMaterial)
    fitted = material.provenance["friction"]
    assert isinstance(fitted, dict)
    print("| fabric | friction | middle before [mm] | at the lowest | after the ball | bag | processor time [s] |")
    print("|---|---|---|---|---|---|---|")
    bags = []
    for coefficient, of in ((float(fitted["coefficient"]), material), (0.0, replace(material, sliders=None))):
        (ball,) = bagging(of, size=options.size, spacing=options.spacing).cloth.obstacles
        assert isinstance(ball, Sphere)
        ball = replace(ball, motion=replace(ball.motion, start=LATER, duration=SWUNG))
        bags += [cloth(of, ball, coefficient, options), yarns(options.folder.name, ball, coefficient, options.size)]
    if options.picture is not None:
        draw(options.picture, bags)


def cloth(material: CompactMaterial, ball: Sphere, friction: float, options: argparse.Namespace) -> Bag:
    """The bag of cloth, whose rim is held with its slope, as that of yarns."""
    scene = bagging(material, size=options.size, spacing=options.spacing)
    wide = options.size + 2.0 * options.spacing
    mesh = rectangle(wide, wide, options.spacing)
    flat = ClothState.flat(mesh)
    rim = np.flatnonzero(np.abs(mesh.panel).max(axis=1) > 0.5 * options.size - 0.1 * options.spacing)
    held = (Handle("rim", rim, flat.positions[rim]),)
    held_cloth = replace(scene.cloth, mesh=mesh, handles=held, obstacles=(ball,), damping=DAMPING)
    scene = replace(scene, cloth=held_cloth, start=flat)
    states, seconds = swung(scene.body, scene.start, FRAME / 2)
    shapes = [state.positions for state in (scene.start, *states)]
    return measured("cloth", friction, shapes, options.size, seconds, Surface(scene.cloth.mesh.triangles))


def yarns(name: str, ball: Sphere, friction: float, size: float) -> Bag:
    """The bag of a sheet of yarns that is cut a little outside of the rim."""
    file = material_library.file_of(name, material_library.PATTERN)
    pattern, material = read_pattern(file), read_yarns(file)
    assert material is not None
    fabric = RodFabric.cut(pattern, material, *(round((size + 2.0 * RIM) / float(period)) for period in pattern.period))
    places = fabric.sheet.vertices
    places = places - 0.5 * (places.min(axis=0) + places.max(axis=0))
    fabric = replace(fabric, sheet=fabric.sheet.moved(places))
    rim = np.flatnonzero(np.abs(places[:, :2]).max(axis=1) > 0.5 * size)
    loads = SheetScene((0.0, 0.0, -GRAVITY), (Handle("rim", rim, places[rim]),), (ball,), BALL_FRICTION)
    scene = RodScene(fabric, loads, friction=friction, damping=DAMPING)
    states, seconds = swung(scene.body, scene.start, USUAL_STEP)
    shapes = [scene.points(state) for state in (scene.start, *states)]
    print(f"{len(places)} vertices, passages {scene.energy.passage_count}", file=sys.stderr, flush=True)
    return measured("yarns", friction, shapes, size, seconds, fabric.sheet)


def swung(body: Body[Any], start: Any, step: float) -> tuple[list[Any], float]:
    """States at rest before the ball comes, when it is lowest, and at rest after it; processor time [s]."""
    began = time.process_time()
    hung = simulate(body, start, Schedule(HANG, step))
    # To rest takes a time of its own.
    lowest = simulate(body, replace(hung.state, time=LATER), Schedule(0.5 * SWUNG, step, to_rest=False))
    after = simulate(body, lowest.state, Schedule(0.5 * SWUNG, step))
    for run in (hung, lowest, after):
        print(f"{run.outcome}: {run.steps} steps, {run.newton_iterations} iterations, {run.loose_steps} loose, unrest "
              f"{run.unrest:.3g}, {time.process_time() - began:.0f} s", file=sys.stderr, flush=True)  # fmt: skip
    return [run.state for run in (hung, lowest, after)], time.process_time() - began


def measured(
    name: str, friction: float, shapes: Sequence[Array], size: float, seconds: float, subject: Surface | YarnSheet
) -> Bag:
    """The bag of points (n, 3) [m] at the start and in three states; a row of the table."""
    start = shapes[0]
    sinking = np.array([start[:, 2] - shape[:, 2] for shape in shapes[1:]])
    strip = (np.abs(start[:, 1]) < NEAR * size) & (np.abs(start[:, 0]) < 0.5 * size)
    edges = np.linspace(-0.5, 0.5, round(0.5 / NEAR) * 2 + 2) * size  # an odd number, one of them in the middle
    owner = np.digitize(start[:, 0], edges[1:-1])
    depths = np.stack([sinking[:, strip & (owner == k)].mean(axis=1) for k in range(len(edges) - 1)], axis=1)
    middle = 1e3 * depths[:, len(edges) // 2 - 1]
    numbers = " | ".join(f"{value:.2f}" for value in (*middle, middle[2] - middle[0]))
    print(f"| {name} | {friction:g} | {numbers} | {seconds:.0f} |", flush=True)
    return Bag(f"{name}, friction {friction:g}", 0.5 * (edges[1:] + edges[:-1]), depths, shapes[-1], subject)


def draw(path: Path, bags: Sequence[Bag]) -> None:
    """Both fabrics with friction after the ball, seen from below the horizon of the rim, and profiles of all."""
    import matplotlib.pyplot as plt

    _, axes = plt.subplots(1, 3, figsize=(14, 4.4), constrained_layout=True)
    for axis, bag in zip(axes[:2], bags, strict=False):
        part = path.with_name(f"{path.stem}-part.png")
        camera, pixels = (0.35, -1.0, 0.45), (640, 560)
        if isinstance(bag.subject, YarnSheet):
            ends = zip(bag.subject.offsets[:-1], bag.subject.offsets[1:], strict=True)
            curves = [Curve(bag.shape[a:b], number) for number, (a, b) in enumerate(ends)]
            yarn_picture(part, curves, bag.subject.radius, camera=camera, size=pixels)
        else:
            shape = bag.shape
            frames_picture(part, Animation(np.zeros(1), lambda _, shape=shape: Moment(0.0, cloth=shape), bag.subject),
                           camera=camera, size=pixels, titles=[" "])  # fmt: skip
        axis.imshow(plt.imread(part))
        axis.set(title=f"{bag.name}, after the ball")
        axis.axis("off")
        part.unlink()
    for number, bag in enumerate(bags):
        colour = f"C{number // 2}"
        for depths, style in zip(bag.depths[::2], (":", "-"), strict=True):
            line = {"color": colour, "linestyle": style, "marker": "." if isinstance(bag.subject, YarnSheet) else ""}
            axes[2].plot(1e3 * bag.places, -1e3 * depths, label=bag.name if style == "-" else None, **line)
    axes[2].set(title="before (dotted) and after the ball", xlabel="x [mm]", ylabel="height [mm]")
    axes[2].legend()
    plt.savefig(path, dpi=100)


if __name__ == "__main__":
    main()
