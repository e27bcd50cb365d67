"""Make the small materials of this folder: built-in patterns at rest, homogenized with few solves.

Run ``python tests/fabrics/make.py [NAME ...]``; one or two minutes each on one core. Half of the states lie within
a seventh of the range: knits change their stiffness there, where loops begin to touch and buckle.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from yarnscale.cell import PeriodicCell
from yarnscale.cell.rest import settled
from yarnscale.drawing.library import STRUCTURES
from yarnscale.files.material_json import write_material
from yarnscale.homogenize.homogenize import fit_published
from yarnscale.homogenize.plan import StrainRange, axes_and_planes, scattered_axes
from yarnscale.homogenize.sample import create_store, sample
from yarnscale.yarn.material import YarnMaterial

FABRICS = {"stockinette": 0.8, "rib-1x1": 0.75, "honeycomb": 0.8, "plain": 0.8, "satin-5": 0.8}
"""Share of the drawn curvature that the yarns have at rest (see ``settled``); with less of it a rib draws in more."""
SOLVES, NEAR = 100, 0.15
"""States of each of the two plans, and the share of the range that the second one covers."""


def main() -> None:
    """Settle, sample, fit and write each of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help=", ".join(FABRICS))
    for name in parser.parse_args().names or FABRICS:
        structure = STRUCTURES[name]
        yarn = YarnMaterial.preset(structure.material)
        rest = settled(structure.build(), yarn, setting=FABRICS[name])
        box = StrainRange().bounds(rest.pattern.radius)
        # Both plans hold the state of rest; the store wants it once.
        states = np.concatenate([axes_and_planes(box, SOLVES), axes_and_planes(NEAR * box, SOLVES)[1:]])
        with tempfile.TemporaryDirectory() as folder:
            cell = PeriodicCell(rest.pattern, yarn)
            store = create_store(Path(folder) / "samples", cell, scattered_axes(states), scattered=True)
            summary = sample(cell, store, workers=1)
            material = fit_published(store)
        write_material(Path(__file__).with_name(f"{name}.json"), material)
        told = f"{summary.converged} of {summary.states} states in {summary.seconds:.0f} s"
        print(f"{name}: {rest.status.value}; {told}", flush=True)


if __name__ == "__main__":
    main()
