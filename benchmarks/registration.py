"""Registration of rendered knits: photographs of relaxed cells, registered, compared with the cells themselves.

`python benchmarks/registration.py [PATTERN …]` (stockinette, rib-1x1, seed, garter) prints the errors of stitch
density, radius and centre lines, and of energy and tension of the yarn at rest as it lies (EST22 §7.2) in both
geometries. Every photograph is turned a little, unevenly lit, blurred and noisy. Nothing is set by hand.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np
from scipy import ndimage
from scipy.spatial import KDTree

import yarnscale as ys
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.cell.rest import estimated_rest
from yarnscale.drawing import library
from yarnscale.drawing.curves import PeriodicCurve
from yarnscale.show.canvas import aim, light, screen
from yarnscale.show.curves import periodic_curves
from yarnscale.show.seen_tubes import add_tubes, tube_mesh
from yarnscale.swatches.registration.curves import YarnCurves
from yarnscale.swatches.registration.registration import SIDES, Registration, registered
from yarnscale.swatches.registration.start import flattened
from yarnscale.yarn.pattern import YarnPattern

PIXELS_PER_RADIUS = 8.0
TURNS = {"front": 1.0, "back": -0.7}
"""Angle of each photograph [degrees]."""
STRETCHES = (0.05, 0.1, 0.15, 0.2)


def photographs(pattern: YarnPattern, *, size: tuple[int, int] = (900, 800), seed: int = 0) -> dict[str, np.ndarray]:
    """Both sides of a pattern (rows, columns, 3) as a camera sees them, ``PIXELS_PER_RADIUS``."""
    return {side: _photograph(_rendered(pattern, side, size), TURNS[side], seed + k) for k, side in enumerate(SIDES)}


def _rendered(pattern: YarnPattern, side: str, size: tuple[int, int]) -> np.ndarray:
    width, height = np.array(size) / PIXELS_PER_RADIUS * pattern.radius

    def place(vertices: np.ndarray, tiles: np.ndarray) -> np.ndarray:
        points = pattern.vertices[vertices].copy()
        points[:, :2] += tiles * pattern.period
        return points

    rings = tuple(int(np.ceil(0.5 * extent / p)) + 1 for extent, p in zip((width, height), pattern.period, strict=True))
    curves = [replace(curve, solid=None, yarn=0) for curve in periodic_curves(pattern.edges, place, rings=rings)]
    middle = np.array([*(0.3 * pattern.period), 0.0])
    corner = np.array([0.5 * width, 0.5 * height, 5.0 * pattern.radius])
    with screen(size) as plotter:
        light(plotter)
        add_tubes(plotter, tube_mesh(curves, pattern.radius), pattern.radius)
        plotter.set_background("#303030")
        aim(plotter, np.stack([middle - corner, middle + corner]), camera=(0.0, 0.0, SIDES[side]), margin=1.0)
        return np.asarray(plotter.screenshot(return_img=True))[..., :3]


def _photograph(picture: np.ndarray, turn: float, seed: int) -> np.ndarray:
    turned = ndimage.rotate(picture.astype(float), turn, reshape=False, order=1, mode="reflect")
    rows, columns = (np.linspace(-1.0, 1.0, n) for n in turned.shape[:2])
    uneven = turned * (1.0 + 0.15 * columns[None, :, None] - 0.1 * rows[:, None, None] ** 2)
    noise = np.random.default_rng(seed).normal(0.0, 12.0, turned.shape)
    return np.clip(ndimage.gaussian_filter(uneven, (0.7, 0.7, 0.0)) + noise, 0, 255).astype(np.uint8)


def matched(truth: YarnPattern, found: YarnCurves) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances [r] in the plane and in space of the true centre line from the registered one, and which are visible.

    Both are compared over one period, at the place and level that fit best.
    """
    stretch = [*(truth.period / found.period), 1.0]
    lines = replace(found, controls=found.controls * stretch, period=truth.period).samples
    true = YarnCurves.through(_true_lines(truth), truth.period, np.full(len(truth.yarns), truth.radius))
    tiles = np.array([(i, j, 0) for i in range(-3, 4) for j in range(-3, 4)]) * [*truth.period, 0.0]
    tree = KDTree((lines[None] + tiles[:, None]).reshape(-1, 3))
    best, offset = np.inf, np.zeros(3)
    for u in np.linspace(0, 1, 8, endpoint=False):
        for v in np.linspace(0, 1, 8, endpoint=False):
            move = np.array([u, v, 0.0]) * [*truth.period, 0.0]
            for _ in range(30):
                distance, nearest = tree.query(true.samples + move)
                move = move + (tree.data[nearest] - true.samples - move).mean(axis=0)
            if (distance**2).sum() < best:
                best, offset = float((distance**2).sum()), move
    away = tree.data[tree.query(true.samples + offset)[1]] - true.samples - offset
    shown = Registration(true, {}, 1.0)
    visible = shown.seen("front") | shown.seen("back")
    return (
        np.linalg.norm(away[:, :2], axis=1) / truth.radius,
        np.linalg.norm(away, axis=1) / truth.radius,
        visible,
    )


def _true_lines(pattern: YarnPattern) -> list[PeriodicCurve]:
    walked = pattern.vertices.copy()
    walked[:, :2] += pattern.tile_along_yarn * pattern.period
    shifts = [(int(a), int(b)) for a, b in pattern.yarn_shift]
    return [
        PeriodicCurve(walked[chain], shift).smooth(pattern.period)
        for chain, shift in zip(pattern.yarns, shifts, strict=True)
    ]


def curves_of_tension(pattern: YarnPattern, material: ys.YarnMaterial) -> tuple[np.ndarray, np.ndarray]:
    """Energy density [J/m²] and stress [N/m] along course and wale (2, stretches), yarns at rest as they lie."""
    straight = replace(pattern, rest_curvature=0.0 * pattern.rest_curvature, rest_twist=0.0 * pattern.rest_twist)
    cell = PeriodicCell(estimated_rest(PeriodicCell(straight, material)).pattern, material)
    energy, tension = np.empty((2, len(STRETCHES))), np.empty((2, len(STRETCHES)))
    for row, name in enumerate(("s_x", "s_y")):
        state = None
        for column, stretch in enumerate(STRETCHES):
            state = cell.relax(ys.ShellStrain(**{name: stretch}), start=state)
            energy[row, column], tension[row, column] = state.energy_density, state.stress[2 * row]
    return energy, tension


def main(names: list[str]) -> None:
    for name in names or ["stockinette", "rib-1x1", "seed", "garter"]:
        material = ys.YarnMaterial.preset(library.structure(name).material)
        truth = ys.settled(ys.patterns.build(name), material).pattern
        began = time.process_time()
        pictures = flattened({side: picture.mean(axis=2) for side, picture in photographs(truth).items()})
        drawing, guess = registered(
            library.structure(name), pictures, pixel=truth.radius / PIXELS_PER_RADIUS, name=name
        )
        found = guess.fitted(pictures)
        seconds = time.process_time() - began
        density = found.curves.period / truth.period - 1.0
        radius = found.curves.radius / truth.radius
        print(f"{name}: {seconds:.0f} s, periods {100 * density.round(4)} %, radius {radius:.3f}")
        for label, state in (("drawn", guess), ("registered", found)):
            plane, space, visible = matched(truth, state.curves)
            parts = {
                "visible, plane": plane[visible],
                "visible, space": space[visible],
                "hidden, plane": plane[~visible],
            }
            errors = [f"{part} {off.mean():.2f} (largest {off.max():.2f})" for part, off in parts.items() if len(off)]
            print(f"  {label:<10} centre lines [r]: {'; '.join(errors)}")
        true, own = curves_of_tension(truth, material), curves_of_tension(found.pattern(drawing), material)
        for label, one, other in zip(("energy", "tension"), true, own, strict=True):
            worst = np.sqrt(((other - one) ** 2).mean(axis=1)) / np.abs(one).max(axis=1)
            print(
                f"  {label:<8} course, wale at {STRETCHES}: {(100 * (other / one - 1)).round(1).tolist()} %, "
                f"root mean square of the largest {(100 * worst).round(1)} %"
            )


if __name__ == "__main__":
    main(sys.argv[1:])
