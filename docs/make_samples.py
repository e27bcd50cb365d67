"""Make the computed samples in src/yarnscale/samples anew: curves.csv, weft.csv, cloth.json and mesh.obj.

python docs/make_samples.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import yarnscale as ys
from yarnscale.laboratory.programme import Programme

FOLDER = Path(__file__).parents[1] / "src" / "yarnscale" / "samples"
WIDTH, LENGTH = 0.06, 0.10
"""Of a swatch [m]."""
LOADS = (2.0, 5.0, 10.0, 20.0, 35.0, 50.0, 70.0)
"""Of a strip [N/m]."""
NOISE = 0.01


def main() -> None:
    """Pull a periodic cell of stockinette, and write what swatches of it would have shown."""
    yarn = ys.YarnMaterial.preset("wool")
    drawn = ys.patterns.build("stockinette", radius=5e-4)
    cell = ys.PeriodicCell(ys.settled(drawn, yarn).pattern, yarn)
    tests = ys.run_tests(cell, programme=Programme(directions=(0.0, 90.0), loads=LOADS))
    random = np.random.default_rng(1)
    rows = []
    for direction, angle in (("weft", 0.0), ("warp", 90.0)):
        points = [p for p in tests.tension if p.direction == angle and np.isfinite(p.stretch)]
        for run in (1, 2):
            for p in points:
                force, noise = p.load * WIDTH, 1.0 + NOISE * random.standard_normal(3)
                length = 1e3 * LENGTH * (1.0 + p.stretch * noise[1])
                middle = 1e3 * WIDTH * (1.0 - p.contraction * noise[2])
                rows.append(f"{direction},{run},{force * noise[0]:.4f},{length:.2f},{middle:.2f},{1e3 * WIDTH:g}")
    head = [
        "# Synthetic, no measurement: a periodic cell of stockinette of yarnscale's wool, radius 0.5 mm, pulled by",
        f"# yarnscale itself, with noise of {NOISE:.0%}. Swatches of {1e3 * LENGTH:g} x {1e3 * WIDTH:g} mm; "
        "clamps play no part.",
        "direction,run,force_N,clamp_distance_mm,mid_width_mm,swatch_width_mm",
    ]
    (FOLDER / "curves.csv").write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
    _machine_log([p for p in tests.tension if p.direction == 0.0 and np.isfinite(p.stretch)])
    _mesh()


def _machine_log(points: list) -> None:
    """The first direction as a testing machine logs it: extension and force, without widths."""
    stretch, force = [0.0, *(p.stretch for p in points)], [0.0, *(p.load * 0.05 for p in points)]
    at = np.linspace(0.0, stretch[-1], 60)
    lines = [
        "# Synthetic, as curves.csv: a swatch of 100 x 50 mm. No measurement.",
        "Extension (mm);Force (N)",
        *(f"{100.0 * x:.3f};{f:.4f}" for x, f in zip(at, np.interp(at, stretch, force), strict=True)),
    ]
    (FOLDER / "weft.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _mesh() -> None:
    """A sheet of 6 x 6 cm that is bent up at two sides; texture coordinates are metres along the fabric."""
    n, side, radius = 9, 0.06, 0.05
    along = np.linspace(-0.5 * side, 0.5 * side, n)
    lines = ["# A sheet of 6 x 6 cm, bent to a cylinder of 5 cm radius. Positions and texture coordinates in metres."]
    for y in along:
        lines += [f"v {radius * np.sin(x / radius):.6f} {y:.6f} {radius * (1 - np.cos(x / radius)):.6f}" for x in along]
    lines += [f"vt {x:.6f} {y:.6f}" for y in along for x in along]
    for j in range(n - 1):
        for i in range(n - 1):
            a, b, c, d = (k + 1 for k in (j * n + i, j * n + i + 1, (j + 1) * n + i + 1, (j + 1) * n + i))
            lines += [f"f {a}/{a} {b}/{b} {c}/{c}", f"f {a}/{a} {c}/{c} {d}/{d}"]
    (FOLDER / "mesh.obj").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
