"""What homogenized fabrics do and plain shells do not: knits curl at free edges and narrow when stretched."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from yarnscale.files.material_json import read_material
from yarnscale.shell.cloth import Cloth
from yarnscale.shell.contact import ContactSettings
from yarnscale.shell.mesh import rectangle
from yarnscale.shell.simulate import ClothSolver, Schedule, simulate
from yarnscale.shell.spline_material import SplineMaterial
from yarnscale.shell.state import ClothState

FABRICS = Path(__file__).parent / "fabrics"
COURSE, WALE = 0, 2


def fabric(name: str) -> SplineMaterial:
    material = read_material(FABRICS / f"{name}.json")
    assert isinstance(material, SplineMaterial)
    return material


def narrowing(material: SplineMaterial, along: int, stretch: float) -> float:
    """How much a piece that is free across its pull narrows between no stretch and ``stretch``."""

    def width(pulled: float) -> float:
        def energy(across: float) -> float:
            strain = np.zeros(6)
            strain[along], strain[2 - along] = pulled, across
            return float(material.energy_density(strain))

        return minimize_scalar(energy, bounds=(-0.45, 0.3), method="bounded").x

    return width(0.0) - width(stretch)


def without_pairs(material: SplineMaterial) -> SplineMaterial:
    """Only the terms of one strain each (HYLC20 Fig. 17)."""
    return replace(material, planes={}, inside=None)


def test_stockinette_narrows_when_stretched_and_plain_weave_hardly() -> None:
    knit, weave = fabric("stockinette"), fabric("plain")
    assert narrowing(knit, COURSE, 0.2) > 0.1 and narrowing(knit, WALE, 0.4) > 0.1
    for along in (COURSE, WALE):
        assert abs(narrowing(weave, along, 0.2)) < 0.03


@pytest.mark.parametrize("name", ["stockinette", "plain"])
def test_without_terms_of_pairs_nothing_narrows(name: str) -> None:
    for along in (COURSE, WALE):
        assert abs(narrowing(without_pairs(fabric(name)), along, 0.2)) < 1e-3


def curl(material: SplineMaterial, size: float, spacing: float) -> tuple[float, float]:
    """Mean height of the middles of the course edges and of the wale edges over the centre, in units of half the size.

    A free sheet without weight, a moment after it is let go; z points to the right side of the fabric.
    """
    mesh = rectangle(size, size, spacing)
    cloth = Cloth(mesh, material, gravity=(0, 0, 0), contact=ContactSettings(thickness=5e-4), damping=5.0)
    run = simulate(ClothSolver(cloth), ClothState.flat(mesh), Schedule(0.06, 0.02, to_rest=False))
    assert run.converged
    heights = run.state.positions[:, 2] / (0.5 * size)
    middle = heights[mesh.nearest_vertex((0.0, 0.0))]
    edge = 0.5 * size
    course, wale = (
        np.mean([heights[mesh.nearest_vertex(point)] for point in both]) - middle
        for both in ([(0.0, edge), (0.0, -edge)], [(edge, 0.0), (-edge, 0.0)])
    )
    return float(course), float(wale)


def test_stockinette_curls_at_free_edges_to_the_sides_of_real_fabric() -> None:
    """Its first and last rows roll to the right side, its sides to the wrong side: moments, then the shape."""
    knit = fabric("stockinette")
    stress = knit.stress(np.zeros(6))
    # A moment that lowers the energy by negative curvature along the course, positive along the wale.
    assert stress[3] > 1e-5 and stress[5] < -1e-5
    course, wale = curl(knit, 0.06, 0.006)
    assert course > wale + 0.3


def test_plain_weave_stays_flat() -> None:
    weave = fabric("plain")
    np.testing.assert_allclose(weave.stress(np.zeros(6))[3:], 0.0, atol=1e-10)
    # No moment lifts it; it shrinks a little in its plane, and round-off may make it buckle.
    np.testing.assert_allclose(curl(weave, 0.03, 0.006), 0.0, atol=0.05)


def test_published_stockinette_curls_as_ours(shared: Path) -> None:
    material = read_material(shared / "reference" / "stock1.json")
    assert isinstance(material, SplineMaterial)
    stress = material.stress(np.zeros(6))
    assert stress[3] > 1e-5 and stress[5] < -1e-5
    course, wale = curl(material, 0.06, 0.008)
    assert course > wale + 0.3
