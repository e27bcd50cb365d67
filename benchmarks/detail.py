"""Yarn detail: seconds a frame over the number of yarn vertices, and how true the interpolated yarns are.

Run ``python benchmarks/detail.py STORE [--pattern P] [--frames DIR …]``; STORE is a grid of samples of the pattern,
such as ``yarnscale detail`` leaves in ``yarns/samples``; frames are runs of ``stretch``, ``drape`` or ``simulate``.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from yarnscale.cell import PeriodicCell
from yarnscale.cell.equilibrium import Start
from yarnscale.detail.fluctuations import FluctuationTable
from yarnscale.detail.overlap import Overlap
from yarnscale.detail.yarns import YarnDetail
from yarnscale.files.cloth_frames import read_cloth_frames
from yarnscale.files.material_toml import read_yarn_material
from yarnscale.files.patterns import read_pattern
from yarnscale.homogenize.store import SampleStore
from yarnscale.kinematics import ShellStrain
from yarnscale.shell.mesh import TriangleMesh, rectangle

SIZES = (0.15, 0.3, 0.49, 0.7, 1.1)
SHARES = (0.9, 0.8, 0.7, 0.5)


def speed(table: FluctuationTable) -> None:
    print("sheet [m]  triangles  yarn vertices  layout [s]  strains [ms]  frame [ms]  ns a vertex")
    for size in SIZES:
        mesh = rectangle(size, size, 0.0065)
        began = time.perf_counter()
        detail = YarnDetail.of(table, mesh)
        layout = time.perf_counter() - began
        x, y = mesh.material.T
        wavy = np.column_stack([1.1 * x, 0.95 * y, 0.01 * np.sin(60 * x) * np.cos(40 * y)])
        strains, frame = _least(detail.surface.forms, wavy), _least(detail.curves, wavy)
        count = detail.layout.vertex_count
        print(
            f"{size:9.2f} {len(mesh.triangles):10d} {count:14d} {layout:11.2f} {1e3 * strains:13.1f} "
            f"{1e3 * frame:11.1f} {1e9 * frame / count:12.0f}"
        )


def _least(run: Callable[[np.ndarray], object], positions: np.ndarray, repeats: int = 5) -> float:
    run(positions)
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        run(positions)
        times.append(time.perf_counter() - began)
    return min(times)


def truth(cell: PeriodicCell, table: FluctuationTable, count: int = 30) -> None:
    """Interpolated fluctuations against equilibria relaxed from them, at random states."""
    low, high = np.array([axis[0] for axis in table.axes]), np.array([axis[-1] for axis in table.axes])
    radius, generator = cell.pattern.radius, np.random.default_rng(1)
    box = {
        "mild": ([-0.05, -0.3, -0.05, 0, 0, 0], [0.3, 0.3, 0.3, 0, 0, 0]),
        "stretched": ([0, low[1], 0, 0, 0, 0], [high[0], high[1], high[2], 0, 0, 0]),
        "compressed": ([low[0], -0.3, low[2], 0, 0, 0], [0, 0.3, 0.2, 0, 0, 0]),
        "bent along x": ([0, -0.3, 0, low[3], 0, 0], [0.5, 0.3, 0.5, high[3], 0, 0]),
        "bent along y": ([0, -0.3, 0, 0, 0, low[4]], [0.5, 0.3, 0.5, 0, 0, high[4]]),
        "twisted": ([0, -0.3, 0, 0, 0.5 * low[3], 0], [0.5, 0.3, 0.5, 0, 0.5 * high[3], 0]),
    }
    print("\nstates         mean |Δû|/r: median    90 %     max   closest, diameters: here  (p10)  relaxed  (p10)")
    vertices = np.arange(len(cell.pattern.vertices))
    for name, (start, stop) in box.items():
        errors, here, relaxed = [], [], []
        for _ in range(count):
            strain = ShellStrain.from_vector(generator.uniform(start, stop))
            state = strain.vector[[0, 1, 2, 3, 5]]
            shape = table.at(np.broadcast_to(state, (len(vertices), 5)), vertices)
            energy = cell.energy(strain)
            free = energy.start()
            free[: shape.size] = shape.ravel() / radius
            truth = cell.relax(strain, start=Start(strain, shape, cell.pattern.twist))
            errors.append(np.linalg.norm(truth.fluctuation - shape, axis=1).mean() / radius)
            here.append(energy.gaps(free).min())
            relaxed.append(truth.min_distance_over_diameter)
        e, g, t = (
            np.quantile(values, q) for values, q in ((errors, [0.5, 0.9, 1]), (here, [0.5, 0.1]), (relaxed, [0.5, 0.1]))
        )
        print(f"{name:<14} {e[0]:20.3f} {e[1]:7.3f} {e[2]:7.3f} {g[0]:26.3f} {g[1]:7.3f} {t[0]:8.3f} {t[1]:7.3f}")


def overlap(table: FluctuationTable, run: Path) -> None:
    """Shares of segments of the last frame whose nearest yarn is too near."""
    inner = run / "frames"
    frames = read_cloth_frames(inner if inner.is_dir() else run)
    positions = frames.state(max(frames.paths)).positions
    mesh = TriangleMesh(frames.material, frames.triangles, 0.0, frames.corners, positions)
    detail = YarnDetail.of(table, mesh)
    found = Overlap.of(detail, detail.curves(positions))
    inside = np.ones(detail.layout.vertex_count, bool)
    inside[detail.layout.offsets[1:] - 1] = False
    bend = np.abs(detail.states(positions)[inside, 3:]).max(axis=1) * detail.radius
    print(f"\n{run}: segments whose nearest yarn is nearer than so many diameters")
    print("curvature × r   of all " + "".join(f"{share:>9}" for share in SHARES) + "  closest")
    for limit in (0.02, 0.05, 0.1, np.inf):
        chosen = found.fabric[bend < limit]
        shares = "".join(f"{(chosen < share).mean():9.4f}" for share in SHARES)
        print(f"{'< ' + str(limit):<14} {np.mean(bend < limit):7.3f} {shares} {chosen.min():8.3f}")
    print(f"other layers: {np.isfinite(found.layers).mean():.4f} within one diameter")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("store", type=Path)
    parser.add_argument("--pattern", default="stockinette")
    parser.add_argument("--material", default="hylc2020-stockinette")
    parser.add_argument("--frames", type=Path, nargs="*", default=[])
    options = parser.parse_args()
    pattern = read_pattern(options.pattern)
    table = FluctuationTable.from_store(SampleStore(options.store), pattern)
    speed(table)
    truth(PeriodicCell(pattern, read_yarn_material(options.material)), table)
    for run in options.frames:
        overlap(table, run)


if __name__ == "__main__":
    main()
