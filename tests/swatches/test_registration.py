"""Yarns registered to pictures: periods, radius, centre lines, and the order over and under."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.swatches.registration.curves import YarnCurves
from yarnscale.swatches.registration.lattice import Lattice, even, lattice_of
from yarnscale.swatches.registration.registration import SIDES, Registration, registered
from yarnscale.swatches.registration.start import drawn, flattened, repeat_of
from yarnscale.swatches.registration.traced_fit import onto_lines
from yarnscale.yarn.clearance import closest_approach
from yarnscale.yarn.frames import curve_length

PIXEL = 1.0 / 6.0
"""Of the pictures here [r]."""
Picture = Callable[[YarnCurves, str], np.ndarray]


def test_periods_of_a_turned_picture() -> None:
    rows, columns = np.meshgrid(np.arange(300), np.arange(320), indexing="ij")
    course, wale = np.array([31.3, 1.7]), np.array([-1.1, -22.6])
    u, v = np.linalg.solve(np.column_stack([course, wale]), np.stack([columns.ravel(), rows.ravel()]))
    waves = np.cos(2 * np.pi * u) + np.sin(2 * np.pi * v) * np.cos(4 * np.pi * u) + 0.01 * rows.ravel()
    found = lattice_of(even(waves.reshape(rows.shape)))
    assert np.abs(found.course - course).max() < 0.1 and np.abs(found.wale - wale).max() < 0.1


def test_repeats_of_charts() -> None:
    assert repeat_of(library.structure("stockinette")) == (1.0, 1.0)
    assert repeat_of(library.structure("interlock")) == (1.0, 1.0)
    doubled = library.Structure("", chart=("kpkp", "kpkp", "kpkp"))
    assert repeat_of(doubled) == (0.5, 1.0 / 3.0)
    striped = library.Structure("", chart=("kpkp", "kpkp"), sizes={"yarns": ["a", "b"]})
    assert repeat_of(striped) == (0.5, 1.0)


@pytest.fixture(scope="module")
def stockinette(lit_picture: Picture) -> tuple[YarnCurves, dict[str, np.ndarray], Registration, Registration]:
    """The true curves [r] (other loops than the chart draws), evened pictures, the first guess and the fit."""
    true = YarnCurves.of(library.build("stockinette", radius=1.0, wale_spacing=8.4, loop_height=8.0))
    pictures = flattened({side: lit_picture(true, side) for side in SIDES})
    _, guess = registered(library.structure("stockinette"), pictures, pixel=PIXEL, name="found")
    return true, pictures, guess, guess.fitted(pictures)


def test_a_rendered_knit_is_found(stockinette) -> None:
    true, _, guess, found = stockinette
    assert np.abs(found.curves.period / true.period - 1.0).max() < 0.01
    assert abs(found.curves.radius - 1.0) < 0.07
    assert min(found.explained.values()) > 0.95
    lengths = [line.length(curves.period) for curves in (true, found.curves) for line in curves.lines()]
    assert abs(lengths[1] / lengths[0] - 1.0) < 0.05
    # The fit is nearer than the drawing, side by side at the place that suits each best.
    assert _away(true, found.curves) < min(0.2, _away(true, guess.curves))


def _away(true: YarnCurves, found: YarnCurves) -> float:
    """Root mean square distance of centre lines in the plane over all places of one on the other [r]."""
    from scipy.spatial import KDTree

    tiles = np.array([(i, j) for i in range(-2, 3) for j in range(-2, 3)]) * true.period
    between = np.linspace(0.0, 1.0, 4, endpoint=False)[:, None, None] * (found.following - found.samples)
    lines = (found.samples + between).reshape(-1, 3)[:, :2] * (true.period / found.period)
    tree = KDTree((lines[None] + tiles[:, None]).reshape(-1, 2))
    best = np.inf
    for u in np.linspace(0.0, 1.0, 6, endpoint=False):
        for v in np.linspace(0.0, 1.0, 6, endpoint=False):
            move = np.array([u, v]) * true.period
            for _ in range(20):
                distance, nearest = tree.query(true.samples[:, :2] + move)
                move = move + (tree.data[nearest] - true.samples[:, :2] - move).mean(axis=0)
            best = min(best, float(np.sqrt((distance**2).mean())))
    return best


def test_points_set_by_hand_stay_and_periods_carry_the_yarns(stockinette) -> None:
    _, pictures, _, found = stockinette
    lattice = found.lattices["back"]
    place = lattice.pixels(found.curves.controls[3, :2] / found.curves.period) + np.array([2.0, -1.0])
    moved = found.moved("back", 3, place + 2 * lattice.course - lattice.wale)
    assert moved.pins == {3}
    assert np.abs(lattice.pixels(moved.curves.controls[3, :2] / moved.curves.period) - place).max() < 1e-6
    again = moved.fitted(pictures)
    shift = again.lattices["back"].pixels(again.curves.controls[3, :2] / again.curves.period) - place
    assert np.abs(shift).max() < 1.0
    wider = found.with_lattice("front", Lattice(lattice.origin, 1.1 * found.lattices["front"].course, lattice.wale))
    assert wider.curves.period[0] == pytest.approx(1.05 * found.curves.period[0], rel=1e-3)
    assert found.explained and found.apart and again.explained and again.apart
    assert not moved.explained and not moved.apart and not wider.explained and not wider.apart
    for course, wale, fault in (
        (-lattice.course, lattice.wale, "mirrored"),
        (lattice.course, 20 * lattice.course + 0.1 * lattice.wale, "nearly one direction"),
        (0.1 * lattice.course, lattice.wale, "to 4800 pixels each way"),
        (lattice.course, 1e4 * lattice.wale, "to 4800 pixels each way"),
    ):
        with pytest.raises(InputError, match=fault):
            found.with_lattice("back", Lattice(lattice.origin, course, wale))
    with pytest.raises(InputError, match="control point"):
        found.moved("front", 1000, place)


def test_a_pattern_leaves_with_yarns_apart(stockinette) -> None:
    _, _, _, found = stockinette
    drawing = library.build("stockinette")
    pattern = found.pattern(drawing)
    assert pattern.name == "stockinette" and pattern.period == pytest.approx(found.curves.period)
    edges = pattern.edge_vectors()
    assert np.allclose(pattern.rest_length, curve_length(edges, pattern.previous_vertex, pattern.next_vertex))
    # The smooth yarns of the pattern are the curves again, as long and at the same places.
    again = YarnCurves.of(pattern)
    lengths = [line.length(curves.period) for curves in (found.curves, again) for line in curves.lines()]
    assert lengths[1] == pytest.approx(lengths[0], rel=2e-3) and _away(found.curves, again) < 0.03


def test_first_guesses_and_periods_set_by_hand_leave_with_yarns_apart(stockinette) -> None:
    _, _, guess, found = stockinette
    drawing = library.build("stockinette")
    lattice = found.lattices["front"]
    narrower = found.with_lattice("front", Lattice(lattice.origin, 0.85 * lattice.course, 0.85 * lattice.wale))
    assert closest_approach(guess.pattern(drawing)).distance > 1.9 * guess.curves.radius
    kept = closest_approach(replace(narrower, apart=True).pattern(drawing)).distance
    assert kept + 0.02 * narrower.curves.radius < closest_approach(narrower.pattern(drawing)).distance


def test_pictures_that_do_not_repeat_and_scales_that_differ(lit_picture: Picture) -> None:
    noise = np.random.default_rng(0).normal(size=(200, 200))
    with pytest.raises(InputError, match="nothing repeats along the course"):
        lattice_of(even(noise))
    true = YarnCurves.of(library.build("stockinette", radius=1.0))
    large = ndimage.zoom(lit_picture(true, "back"), 1.3)
    pictures = flattened({"front": lit_picture(true, "front"), "back": large})
    with pytest.raises(InputError, match="front and back differ"):
        registered(library.structure("stockinette"), pictures, pixel=PIXEL, name="x")


def test_lines_traced_over_what_is_seen_lead_the_yarns() -> None:
    """Visible runs of a known fabric, each side at a place of its own, the back mirrored as photographs are."""
    # Another fabric than the chart is drawn as: each wale leans, and loops of both beds lie apart in depth.
    true = YarnCurves.of(library.build("rib-1x1", radius=1.0, wale_spacing=8.8, loop_height=8.0))
    lean = 0.6 * np.sin(2 * np.pi * true.controls[:, :1] / true.period[0] + [0.3, 1.0])
    true = replace(true, controls=np.column_stack([true.controls[:, :2] + lean, true.controls[:, 2]]))
    state, lines = Registration(true, {}, 1.0), {}
    for side, turn in (("front", 1.0), ("back", -1.0)):
        seen, points = state.seen(side), true.samples[:, :2] * [turn, 1.0] + [1.3 * turn, 0.4]
        runs = np.split(np.arange(len(seen)), np.flatnonzero(np.diff(seen.astype(int))) + 1)
        lines[side] = [points[run] for run in runs if seen[run[0]] and len(run) > 1]
    _, curves = drawn(library.structure("rib-1x1"), true.period, 1.0, name="x")
    found = onto_lines(curves, lines)
    assert _away(true, found.curves) < min(0.2, 0.5 * _away(true, curves))
    lengths = [line.length(true.period) for shown in (true, found.curves) for line in shown.lines()]
    assert lengths[1] == pytest.approx(lengths[0], rel=0.05)
    with pytest.raises(InputError, match=r"cover \d+ of \d+ points that it shows"):
        onto_lines(curves, lines | {"back": lines["back"][:1]})
