"""What homogenized fabrics do and plain shells do not: knits curl at free edges and narrow when stretched, rib is
softer across than along."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from yarnscale.files.material_json import read_material
from yarnscale.motion.handles import Handle
from yarnscale.motion.rigid import Motion
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.shell.contact.cloth_contact import ContactSettings
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver
from yarnscale.shell.materials.spline_material import SplineMaterial
from yarnscale.shell.mesh import rectangle
from yarnscale.shell.scenes.scene import central_stretch
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
    return replace(material, planes={})


def pulled(material: SplineMaterial, along: int, stretch: float) -> np.ndarray:
    """Stress of a piece that is free across its pull, (6,)."""
    strain = np.zeros(6)
    strain[along], strain[2 - along] = stretch, -narrowing(material, along, stretch)
    return material.stress(strain)


def test_knits_narrow_when_stretched_and_plain_weave_hardly() -> None:
    weave = fabric("plain")
    for along, name in itertools.product((COURSE, WALE), ("stockinette", "rib-1x1", "honeycomb")):
        assert narrowing(fabric(name), along, 0.3) > 0.1, (name, along)
    for along in (COURSE, WALE):
        assert abs(narrowing(weave, along, 0.3)) < 0.01


def test_rib_is_far_softer_across_than_along() -> None:
    rib, plain = fabric("rib-1x1"), fabric("plain")
    # Across, its wales unfold first, with hardly a force; beyond 0.35 or so their loops are pulled too.
    for stretch, times in ((0.2, 5.0), (0.3, 5.0), (0.5, 2.5)):
        across, along = pulled(rib, COURSE, stretch)[COURSE], pulled(rib, WALE, stretch)[WALE]
        assert along > times * abs(across)
    assert pulled(plain, COURSE, 0.2)[COURSE] == pytest.approx(pulled(plain, WALE, 0.2)[WALE], rel=0.01)


@dataclass(frozen=True)
class Strip:
    """A square sheet after a pull: relative width, stretch across in its middle, height of its edges [m], force [N]."""

    width: float
    across: float
    edges: float
    force: float


def strip(material: SplineMaterial, along: int, *, stretch: float = 0.3, spacing: float = 0.008) -> Strip:
    """A weightless sheet of 12 cm held along two whole sides and pulled; then the others curl and come to rest."""
    size = 0.12
    mesh = rectangle(size, size, spacing)
    start, axis = ClothState.flat(mesh), 0 if along == COURSE else 1
    clamps = []
    for side in (-1.0, 1.0):
        held = np.flatnonzero(side * mesh.panel[:, axis] > 0.5 * size - 0.6 * spacing)
        way = [0.0, 0.0, 0.0]
        way[axis] = side * 0.5 * stretch * (size - spacing)
        clamps.append(Handle(f"clamp {side:g}", held, start.positions[held], Motion((*way,), 0.0, 0.2)))  # type: ignore[arg-type]
    contact = ContactSettings(thickness=1e-3)
    cloth = Cloth(mesh, material, tuple(clamps), gravity=(0, 0, 0), contact=contact, damping=3.0)
    solver = ClothSolver(cloth)
    run = simulate(solver, start, Schedule(0.3, 0.03, rough_iterations=40))
    assert run.converged and run.faults["intersections"] == 0
    positions, middle = run.state.positions, np.abs(mesh.panel[:, axis]) < 0.6 * spacing
    outermost = middle & (np.abs(mesh.panel[:, 1 - axis]) > 0.5 * size - 1e-6)
    return Strip(
        width=float(np.ptp(positions[middle, 1 - axis])) / size,
        across=float(central_stretch(mesh, positions, 0.02)[1 - axis]),
        edges=float(positions[outermost, 2].mean()),
        force=abs(float(solver.pull(clamps[1], run.state)[axis])),
    )


@pytest.mark.parametrize("along", [COURSE, WALE])
def test_stretched_stockinette_narrows_and_curls_by_its_terms_of_pairs(along: int) -> None:
    """HYLC20 Fig. 17: free sides roll up under tension, rows to the right side, wales to the wrong side."""
    knit = fabric("stockinette")
    whole, single = strip(knit, along), strip(without_pairs(knit), along)
    assert whole.across < 0.9 and whole.width < 0.65
    assert single.across > 0.99 and single.width > 0.98
    right_side = 1.0 if along == COURSE else -1.0
    assert right_side * whole.edges > 5e-3
    assert abs(single.edges) < 0.25 * abs(whole.edges)
    # The moment that rolls the sides grows with tension; in the sum of single terms it is that of rest.
    moment = 5 if along == COURSE else 3
    assert abs(pulled(knit, along, 0.3)[moment]) > 10 * abs(knit.stress(np.zeros(6))[moment])


def test_strips_of_rib_and_honeycomb_narrow_and_of_weave_do_not() -> None:
    rib = {along: strip(fabric("rib-1x1"), along, spacing=0.012) for along in (COURSE, WALE)}
    assert rib[WALE].force > 5 * rib[COURSE].force
    for sheet in (rib[WALE], strip(fabric("honeycomb"), COURSE, spacing=0.012)):
        assert sheet.across < 0.85
    for name, along in (("rib-1x1", WALE), ("honeycomb", COURSE)):
        assert strip(without_pairs(fabric(name)), along, spacing=0.012).across > 0.99
    for along in (COURSE, WALE):
        weave = strip(fabric("plain"), along, spacing=0.012)
        assert weave.across == pytest.approx(1.0, abs=0.01) and weave.width == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("name", ["stockinette", "rib-1x1", "honeycomb", "plain"])
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


def test_finer_edges_resolve_a_curl_with_fewer_vertices() -> None:
    """Energy of a rolled strip over the mesh: from above, and sooner where rows are closer at the edges."""
    knit = without_pairs(fabric("stockinette"))

    def gained(spacing: float, finer_edges: float = 0.0) -> float:
        mesh = rectangle(0.12, 0.06, spacing, finer_edges=finer_edges)
        start = ClothState.flat(mesh)
        ends = np.flatnonzero(np.abs(mesh.panel[:, 0]) > 0.06 - 1e-9)
        cloth = Cloth(mesh, knit, (Handle("ends", ends, start.positions[ends]),), gravity=(0, 0, 0), damping=3.0)
        solver = ClothSolver(cloth)
        run = simulate(solver, start, Schedule(0.4, 1 / 30, rough_iterations=30))
        assert run.converged
        return solver.energies(start)["elastic"] - solver.energies(run.state)["elastic"]

    coarse, middle, fine = gained(0.013), gained(0.0065), gained(0.004)
    assert 0 < coarse < middle < fine
    assert fine - gained(0.013, finer_edges=0.5) < 0.5 * (fine - coarse)


def test_plain_weave_stays_flat() -> None:
    weave, rest = fabric("plain"), np.zeros(6)
    assert np.abs(weave.stress(rest)[3:]).max() < 1e-4 * np.abs(fabric("stockinette").stress(rest)[3:]).max()
    # No moment lifts it; it shrinks a little in its plane, and round-off may make it buckle.
    np.testing.assert_allclose(curl(weave, 0.03, 0.006), 0.0, atol=0.05)


def test_published_stockinette_curls_as_ours(shared: Path) -> None:
    material = read_material(shared / "reference" / "stock1.json")
    assert isinstance(material, SplineMaterial)
    stress = material.stress(np.zeros(6))
    assert stress[3] > 1e-5 and stress[5] < -1e-5
    course, wale = curl(material, 0.06, 0.008)
    assert course > wale + 0.3
