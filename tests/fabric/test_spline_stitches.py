"""Spline yarns of knit and purl stitches: which contacts hold them, and how they hang."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from yarnscale.drawing import library
from yarnscale.drawing.knit import knit
from yarnscale.drawing.stitches import SIGNS, StitchChart
from yarnscale.errors import InputError
from yarnscale.fabric.measures import penetration
from yarnscale.fabric.spline_contacts import SplineContacts
from yarnscale.fabric.spline_knit import SplineFabric, jersey, spline_fabric
from yarnscale.fabric.spline_motion import SplineMotion
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.numerics.newton import Status
from yarnscale.yarn.material import YarnMaterial

WOOL = YarnMaterial.preset("wool")
PLAIN = ("single-jersey", "garter", "links", "rib-1x1", "rib-2x2", "seed", "moss")


def _fabric(name: str, rows: int, columns: int) -> SplineFabric:
    return spline_fabric(library.build(name), StitchChart.read(library.structure(name).chart), rows, columns, WOOL)


@pytest.mark.parametrize("name", PLAIN)
def test_every_loop_is_held_by_four_contacts_on_the_side_of_its_stitch(name: str) -> None:
    chart = StitchChart.read(library.structure(name).chart)
    fabric = _fabric(name, 2, 2)
    stitches, rows = 2 * chart.wales, 2 * chart.courses
    assert len(fabric.first) == stitches * (2 + 4 * (rows - 1))
    assert len(fabric.top) == stitches
    control = fabric.control.reshape(-1, 3)
    between = fabric.first.yarn != fabric.second.yarn
    gap = (fabric.at(control, fabric.first) - fabric.at(control, fabric.second))[between] / fabric.radius
    # They lie on each other: yarns of one radius touch at a distance of two.
    np.testing.assert_allclose(np.linalg.norm(gap, axis=1), 2.35, atol=0.55)
    # Feet and legs of a knit stitch lie behind, before, before, behind the loop below, of a purl stitch the other way.
    row = (fabric.first.yarn[between] % chart.courses).reshape(-1, stitches, 4)[:, :, 0]
    wale = np.arange(stitches) % chart.wales
    own = np.array([[SIGNS[chart.rows[r][w]] for w in wale] for r in row[:, 0]])
    sides = np.sign(gap[:, 2]).reshape(-1, stitches, 4)
    np.testing.assert_array_equal(sides, own[:, :, None] * np.array([-1, 1, 1, -1]))
    for points in (fabric.first, fabric.second, fabric.top):
        assert (points.place >= 0).all() and (points.place <= fabric.segments_per_yarn).all()
    assert penetration(fabric, control) < 0.13


def test_jersey_is_a_chart_of_one_stitch() -> None:
    pattern = knit("k", wale_spacing=9.0, course_spacing=6.0)
    same = spline_fabric(pattern, StitchChart.read("k"), 3, 4, WOOL, segments_per_stitch=8, feet=False)
    known = jersey(3, 4, WOOL)
    np.testing.assert_allclose(same.control, known.control, atol=1e-15)
    np.testing.assert_allclose(same.first.place, known.first.place, atol=1e-12)


def test_a_period_of_two_courses_is_two_rows_of_jersey() -> None:
    pattern = knit(["kk", "kk"], wale_spacing=9.0, course_spacing=6.0)
    chart = StitchChart.read(["kk", "kk"])
    same = spline_fabric(pattern, chart, 2, 2, WOOL, segments_per_stitch=8, feet=False)
    known = jersey(4, 4, WOOL)
    assert same.counts() == known.counts()
    np.testing.assert_allclose(same.control, known.control, atol=2e-5)
    for mine, theirs in ((same.first, known.first), (same.second, known.second), (same.top, known.top)):
        np.testing.assert_array_equal(mine.yarn, theirs.yarn)
        np.testing.assert_allclose(mine.place, theirs.place, atol=0.05)


@pytest.mark.parametrize("name", ["garter", "rib-1x1"])
def test_what_hangs_keeps_its_contacts_and_loses_energy_by_the_step_alone(name: str) -> None:
    fabric, lost, missed = _fabric(name, 2, 2), [], []
    for step in (1 / 1000, 1 / 2000):
        moving = SplineMotion(fabric, held=fabric.top, tolerance=1e-4)
        energies: list[dict[str, float]] = []
        run = simulate(
            moving, moving.start, Schedule(0.02, step, to_rest=False, frame_interval=0.005),
            on_frame=lambda _, motion: energies.append(moving.energies(motion)),  # noqa: B023
        )  # fmt: skip
        assert run.status is Status.CONVERGED and len(energies) == 5
        totals = [sum(e.values()) for e in energies]
        assert all(later < earlier + 1e-12 for earlier, later in itertools.pairwise(totals))
        fallen = -energies[-1]["gravity"]
        assert fallen > 0
        lost.append(-totals[-1] / fallen)
        motion = moving.yarns(run.state)
        missed.append(np.abs(SplineContacts.of(fabric).linearised(motion.positions)[1]).max())
    # Implicit Euler takes energy in proportion to the step, and contacts drift with its square in every step.
    assert lost[1] < 0.75 * lost[0] < 0.6
    assert missed[1] < 0.75 * missed[0] < 0.02 * fabric.radius


def test_a_volume_around_rib_moves_like_the_yarns_but_stiffer() -> None:
    fabric = _fabric("rib-1x1", 2, 2)
    schedule, fallen = Schedule(0.025, 1 / 240, to_rest=False), []
    for shape in (None, (6, 6), (4, 4)):
        volume = None if shape is None else BoundingVolume.around(fabric.control, shape)
        moving = SplineMotion(fabric, volume=volume, held=fabric.top)
        run = simulate(moving, moving.start, schedule)
        assert run.status is Status.CONVERGED
        fallen.append(-moving.energies(run.state)["gravity"])
    assert fallen[0] > fallen[1] > fallen[2] > 0


def test_other_stitches_are_refused_by_their_place() -> None:
    with pytest.raises(InputError, match="row 2 column 2"):
        _fabric("honeycomb", 2, 2)
    with pytest.raises(InputError, match="back needle 1"):
        _fabric("half-cardigan", 2, 2)
    with pytest.raises(InputError, match="needle beds"):
        _fabric("all-needle", 2, 2)
    chart = ["k", "k"]
    with pytest.raises(InputError, match="spline"):
        spline_fabric(knit(chart, yarns=("ab", "a")), StitchChart.read(chart), 2, 2, WOOL)
    chart = ["k", "p"]
    with pytest.raises(InputError, match="one material"):
        spline_fabric(knit(chart, yarns=("a", "b")), StitchChart.read(chart), 2, 2, WOOL)
