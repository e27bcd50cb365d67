"""Loops of a shell material that remembers beside those of its cell: area and largest force of every cycle.

yarnscale homogenize stockinette --friction 0.2 --out m
yarnscale test m/material.json --against m/pattern.json --friction 0.2 --cycles 1 --out loops
python benchmarks/friction_loops.py loops/tests.json
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

NAMES = {"tension": ("stretch", "load"), "shear": ("angle", "force"), "bending": ("curvature", "moment")}


def main() -> None:
    """Print a table of Markdown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tests", type=Path, nargs="+", help="tests.json of a shell material against a cell")
    print("| cycle | area: cell, shell [J/m²] | ratio | share returned: cell, shell | at the end: cell, shell |")
    print("|---|---|---|---|---|")
    for path in parser.parse_args().tests:
        content = json.loads(path.read_text())
        for test, names in NAMES.items():
            pairs = zip(content["against"]["cycles"][test], content["cycles"][test], strict=True)
            for cell, shell in pairs:
                _print(f"{test} {cell['direction']:g}°, {cell['cycle']}", cell, shell, names[test == "tension"], names)


def _print(name: str, cell: dict, shell: dict, of: str, names: tuple[str, str]) -> None:
    if "converged" not in (cell["status"],) or shell["status"] != "converged":
        print(f"| {name} | {cell['status']}, {shell['status']} | | | |")
        return
    areas = [cycle["work"] - cycle["work_returned"] for cycle in (cell, shell)]
    shares = [cycle["work_returned"] / cycle["work"] for cycle in (cell, shell)]
    measured = names[0] if of == "load" else names[1]
    ends = [max(abs(point[measured]) for point in cycle["loading"]) for cycle in (cell, shell)]
    print(
        f"| {name} | {areas[0]:.3g}, {areas[1]:.3g} | {areas[1] / areas[0]:.2f} | {shares[0]:.2f}, {shares[1]:.2f} | "
        f"{measured} {ends[0]:.3g}, {ends[1]:.3g} |"
    )


if __name__ == "__main__":
    main()
