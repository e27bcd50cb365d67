"""Loops of a shell material that remembers beside those of its cell: areas, shares, largest values; a picture.

yarnscale homogenize stockinette --friction 0.2 --out m
yarnscale test m/material.json --against m/pattern.json --friction 0.2 --cycles 1 --out loops
python benchmarks/friction_loops.py loops/tests.json --picture loops.png --bag m/material.json
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from yarnscale.files.material_json import read_material
from yarnscale.motion.scene import run_scene
from yarnscale.shell.scenes.sheet_scenes import bagging

NAMES = {"tension": ("stretch", "load"), "shear": ("angle", "force"), "bending": ("curvature", "moment")}
FREE = {"tension": "stretch", "shear": "force", "bending": "moment"}
"""What is measured where the other value is prescribed."""


def main() -> None:
    """Print a table of Markdown; draw tension and the bag."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tests", type=Path, nargs="+", help="tests.json of a shell material against a cell")
    parser.add_argument("--picture", type=Path, help="draw tension of the first of them, and the bag")
    parser.add_argument("--bag", type=Path, help="material of the bag")
    options = parser.parse_args()
    print("| cycle | area: cell, shell [J/m²] | ratio | share returned: cell, shell | largest: cell, shell |")
    print("|---|---|---|---|---|")
    contents = [json.loads(path.read_text()) for path in options.tests]
    for content in contents:
        for test, free in FREE.items():
            for cell, shell in zip(content["against"]["cycles"][test], content["cycles"][test], strict=True):
                print_row(f"{test} {cell['direction']:g}°", cell, shell, free)
    if options.picture is not None:
        _, axes = plt.subplots(1, 2 if options.bag is None else 3, figsize=(11, 3.4), constrained_layout=True)
        draw_tension(contents[0], axes)
        if options.bag is not None:
            draw_bag(options.bag, axes[2])
        plt.savefig(options.picture, dpi=110)


def print_row(name: str, cell: dict, shell: dict, free: str) -> None:
    """One cycle."""
    if (cell["status"], shell["status"]) != ("converged", "converged"):
        print(f"| {name} | {cell['status']}, {shell['status']} | | | |")
        return
    areas = [cycle["work"] - cycle["work_returned"] for cycle in (cell, shell)]
    shares = [cycle["work_returned"] / cycle["work"] for cycle in (cell, shell)]
    ends = [max(abs(point[free]) for point in cycle["loading"]) for cycle in (cell, shell)]
    print(
        f"| {name} | {areas[0]:.3g}, {areas[1]:.3g} | {areas[1] / areas[0]:.2f} | {shares[0]:.2f}, {shares[1]:.2f} | "
        f"{free} {ends[0]:.3g}, {ends[1]:.3g} |"
    )


def draw_tension(content: dict, axes: np.ndarray) -> None:
    """Cycles along course and wale."""
    for axis, direction in zip(axes[:2], (0.0, 90.0), strict=True):
        for name, kind, style in (("cell", content["against"], "k-"), ("shell", content, "C3--")):
            cycle = next(c for c in kind["cycles"]["tension"] if c["direction"] == direction)
            points = [*cycle["loading"], *cycle["unloading"]]
            axis.plot([p["stretch"] for p in points], [p["load"] for p in points], style, label=name)
        axis.set(title=f"tension along {direction:g}°", xlabel="stretch", ylabel="load [N/m]")
        axis.legend()


def draw_bag(path: Path, axis: plt.Axes) -> None:
    """Profiles of sheets through which a ball has swung, or not, with friction inside and without."""
    material = read_material(path)
    for name, of, depth, style in (
        ("friction, after the ball", material, 0.03, "C3-"),
        ("friction, no ball", material, 0.0, "C0-"),
        ("elastic, after the ball", replace(material, sliders=None), 0.03, "k--"),
    ):
        result = run_scene(bagging(of, depth=depth))
        print(f"bag, {name}: { ({k: round(1e3 * v, 2) for k, v in result.measures.items()}) } mm", flush=True)
        mesh = result.scene.cloth.mesh
        row = np.flatnonzero(np.abs(mesh.panel[:, 1]) < 1e-9)
        row = row[np.argsort(mesh.panel[row, 0])]
        place = 1e3 * result.state.positions[mesh.point_vertices[row]]
        axis.plot(place[:, 0], place[:, 2], style, label=name)
    axis.set(title="a sheet held at its edges", xlabel="x [mm]", ylabel="height [mm]")
    axis.legend()


if __name__ == "__main__":
    main()
