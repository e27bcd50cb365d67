"""Rest shapes: redrawing at an equilibrium, shrinking, estimating, settling."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.cell.release import DIFFERENCE
from yarnscale.cell.rest import (
    RestStatus,
    estimated_rest,
    rebased,
    rest_stress_ratio,
    set_as_drawn,
    settled,
    shrunk_to_rest,
)
from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.kinematics import ShellStrain
from yarnscale.numerics.newton import Status
from yarnscale.yarn.material import YarnMaterial

WOOL = YarnMaterial.preset("wool")


@cache
def at_rest(name, material="wool"):
    """A settled pattern of the library, found once for all tests here."""
    return settled(library.build(name), YarnMaterial.preset(material))


def drawn_energy(cell):
    """Energy of the period [J], and projected gradient over force scale, of the pattern as drawn."""
    energy = cell.energy(ShellStrain())
    x = energy.start()
    value, gradient = energy.gradient(x)
    residual = np.linalg.norm(energy.constraints.project(gradient)) / energy.residual_scale
    return value * energy.unit, residual


@pytest.mark.parametrize("name", ["stockinette", "plain", "seed", "rib-2x2"])
def test_a_rebased_equilibrium_has_the_same_energy_and_no_force(name):
    pattern = library.build(name)
    cell = PeriodicCell(pattern, WOOL).with_options(tolerance=1e-8)
    state = cell.relax(ShellStrain(s_x=0.04, s_y=-0.02))
    assert state.converged
    redrawn = rebased(pattern, state)
    value, residual = drawn_energy(replace(cell, pattern=redrawn))
    assert value == pytest.approx(state.energy_density * pattern.area, rel=1e-10)
    assert value > 0.0
    # The rows against sliding follow the drawing; where they bear force, a trace of it shows. It vanishes below.
    assert residual < 1e-3
    assert np.array_equal(redrawn.rest_length, pattern.rest_length)
    assert np.array_equal(redrawn.rest_curvature, pattern.rest_curvature)
    assert redrawn.period == pytest.approx(pattern.period * [1.04, 0.98], rel=1e-14)


def test_gradient_of_a_rebased_pattern_vanishes_where_sliding_is_free():
    pattern = library.build("plain")
    cell = PeriodicCell(pattern, WOOL, sliding=True).with_options(tolerance=1e-9)
    state = cell.relax(ShellStrain(s_x=0.02, s_y=0.01))
    assert state.converged
    _, residual = drawn_energy(replace(cell, pattern=rebased(pattern, state)))
    assert residual < 2e-9


def test_stress_of_a_rebased_pattern_follows_the_chain_rule():
    pattern = library.build("stockinette")
    cell = PeriodicCell(pattern, WOOL).with_options(tolerance=1e-8)
    state = cell.relax(ShellStrain(s_x=0.05, s_y=0.03))
    again = replace(cell, pattern=rebased(pattern, state)).relax()
    # dE/ds' = (1 + s) dE/ds with energies of the period.
    assert again.stress[0] == pytest.approx(state.stress[0] / 1.03, rel=1e-5)
    assert again.stress[2] == pytest.approx(state.stress[2] / 1.05, rel=1e-5)


def test_rebasing_twice_is_rebasing_once():
    pattern = library.build("garter")
    cell = PeriodicCell(pattern, WOOL).with_options(tolerance=1e-8)
    state = cell.relax(ShellStrain(s_x=0.03))
    once = rebased(pattern, state)
    twice = rebased(once, replace(cell, pattern=once).relax())
    assert np.abs(twice.vertices - once.vertices).max() < 1e-5 * pattern.radius
    assert np.abs(twice.reference_twist - once.reference_twist).max() < 1e-5


def test_sheared_bent_and_foreign_states_are_refused():
    pattern = library.build("plain")
    cell = PeriodicCell(pattern, WOOL)
    with pytest.raises(InputError, match="shear"):
        rebased(pattern, cell.relax(ShellStrain(s_a=0.01)))
    with pytest.raises(InputError, match="shear"):
        rebased(pattern, cell.relax(ShellStrain(II11=5.0)))
    with pytest.raises(InputError, match="another pattern"):
        rebased(library.build("stockinette"), cell.relax())


def test_yarns_set_as_drawn_bear_no_force():
    pattern = set_as_drawn(library.build("stockinette"))
    energy = PeriodicCell(pattern, WOOL).energy(ShellStrain())
    parts = energy.parts(energy.start())
    straight = PeriodicCell(library.build("stockinette"), WOOL).energy(ShellStrain())
    assert parts["stretch"] < 1e-12 and parts["bend_twist"] < 1e-12
    assert straight.parts(straight.start())["bend_twist"] > 1.0


def test_a_part_of_the_setting_scales_curvature_only():
    straight = library.build("plain")
    half = set_as_drawn(replace(straight, rest_length=0.9 * straight.rest_length), share=0.5, lengths=False)
    assert half.rest_curvature == pytest.approx(0.5 * set_as_drawn(straight).rest_curvature, abs=1e-15)
    assert half.rest_length == pytest.approx(0.9 * straight.rest_length)


def test_shrinking_finds_the_minimum_of_the_energy_over_both_periods():
    cell = PeriodicCell(library.build("stockinette"), WOOL).with_options(tolerance=1e-7)
    shape = shrunk_to_rest(cell, shortening=0.03)
    assert shape.status is RestStatus.CONVERGED
    assert shape.stress.largest < 1e-3
    rest = replace(cell, pattern=shape.pattern)
    lowest = rest.relax()
    for strain in (
        ShellStrain(s_x=0.01),
        ShellStrain(s_x=-0.01),
        ShellStrain(s_y=0.01),
        ShellStrain(s_y=-0.01),
    ):
        assert rest.relax(strain, start=lowest).energy_density > lowest.energy_density
    energies = [entry.energy for entry in shape.history]
    assert energies[-1] < energies[0]
    # Straight yarns in a knit: it curls, and no change of the periods can help that.
    assert np.abs(shape.stress.at_rest[3:]).max() > 1e-4
    np.testing.assert_allclose(shape.pattern.rest_length, 0.97 * cell.pattern.rest_length, rtol=1e-12)


def test_a_shorter_yarn_makes_a_smaller_stitch():
    cell = PeriodicCell(set_as_drawn(library.build("stockinette"), lengths=False), WOOL)
    loose, tight = (shrunk_to_rest(cell, shortening=share).pattern for share in (0.02, 0.08))
    assert tight.area < 0.95 * loose.area


@pytest.mark.parametrize("name", ["stockinette", "plain", "rib-1x1"])
def test_estimated_yarns_hold_the_fabric_at_its_periods(name):
    drawn = library.build(name)
    shape = estimated_rest(PeriodicCell(drawn, WOOL))
    assert shape.converged and shape.stress.largest <= 0.01
    assert np.array_equal(shape.pattern.period, drawn.period)
    assert 0.0 < np.abs(shape.pattern.rest_length / drawn.rest_length - 1.0).max() <= 0.2 + 1e-12
    # Set yarns hardly curl: bending stress is at most a tenth of that of straight ones.
    if name == "stockinette":
        straight = PeriodicCell(drawn, WOOL).relax().stress
        assert np.abs(shape.stress.at_rest[[3, 5]]).max() < 0.1 * np.abs(straight[[3, 5]]).max()


SOFT = [(name, "hylc2020-stockinette") for name in ("stockinette", "garter", "twill-2x2", "satin-5")] + [
    ("twill-2x1", "cotton")
]


@pytest.mark.parametrize(("name", "material"), [(name, "wool") for name in library.names()] + SOFT)
def test_every_library_pattern_settles(name, material):
    shape = at_rest(name, material)
    assert shape.converged, shape.status.value
    again = rest_stress_ratio(PeriodicCell(shape.pattern, YarnMaterial.preset(material)))
    assert again.relaxed and (again.ratios <= 0.01).all()
    assert again.course > 0.0 and again.wale > 0.0
    assert shape.seconds > 0.0 and len(shape.history) > 1


def test_settling_is_deterministic():
    first, second = at_rest("garter").pattern, settled(library.build("garter"), WOOL).pattern
    assert first.content_hash() == second.content_hash()


def test_twill_skews_and_is_set_further():
    drawn = library.build("twill-2x2")
    skewed = shrunk_to_rest(PeriodicCell(drawn, WOOL))
    assert skewed.status is RestStatus.SKEWED and not skewed.converged
    assert skewed.stress.ratios[[0, 2]].max() < 0.01 < skewed.stress.ratios[1]
    assert at_rest("twill-2x2").converged


def test_a_search_that_is_cut_short_says_so():
    cell = PeriodicCell(library.build("rib-1x1"), WOOL)
    shape = shrunk_to_rest(cell, max_rounds=1)
    assert shape.status is RestStatus.ROUND_LIMIT and not shape.converged
    assert estimated_rest(cell, max_rounds=2).status is RestStatus.ROUND_LIMIT
    hopeless = shrunk_to_rest(cell.with_options(max_iterations=1))
    assert hopeless.status is RestStatus.NOT_RELAXED


def test_progress_hears_every_round():
    heard = []
    shape = shrunk_to_rest(PeriodicCell(library.build("plain"), WOOL), progress=heard.append)
    assert tuple(heard) == shape.history


def test_parameters_out_of_range_are_refused():
    cell = PeriodicCell(library.build("plain"), WOOL)
    with pytest.raises(InputError, match="shortening"):
        shrunk_to_rest(cell, shortening=0.9)
    with pytest.raises(InputError, match="shortening"):
        estimated_rest(cell, shortening=0.3)
    with pytest.raises(InputError, match="setting"):
        settled(cell.pattern, WOOL, setting=1.5)


def test_a_published_pattern_settles_too(shared):
    from yarnscale.files.patterns import read_pattern

    pattern = read_pattern(shared / "reference" / "satin.pyp")
    material = YarnMaterial.preset("hylc2020-satin")
    before = rest_stress_ratio(PeriodicCell(pattern, material))
    shape = shrunk_to_rest(PeriodicCell(pattern, material))
    assert before.largest > 0.01  # as published it is not at rest in this sense
    assert shape.converged and shape.stress.largest < 0.01
    assert np.abs(shape.pattern.period / pattern.period - 1.0).max() < 0.05


def failing(monkeypatch, fails):
    """Make equilibria without one where ``fails(strain, start)``; strains of steps count from their start."""
    relax = PeriodicCell.relax

    def relaxed(self, strain=None, *, start=None, **options):
        state = relax(self, strain, start=start, **options)
        return replace(state, status=Status.STALLED) if fails(state.strain, start) else state

    monkeypatch.setattr(PeriodicCell, "relax", relaxed)


def test_a_step_without_equilibrium_is_halved(monkeypatch):
    cell = PeriodicCell(library.build("stockinette"), WOOL)
    usual = shrunk_to_rest(cell, shortening=0.06)
    refused = []

    def far(strain, start):
        if start is None or not np.array_equal(strain.vector[[1, 3, 4, 5]], np.zeros(4)):
            return False
        step = np.abs((strain.vector - start.strain.vector)[[0, 2]]).max()
        refused.append(0.015 < step < 0.0499)
        return refused[-1]

    failing(monkeypatch, far)
    found = shrunk_to_rest(cell, shortening=0.06)
    assert any(refused) and found.converged
    np.testing.assert_allclose(found.pattern.period, usual.pattern.period, rtol=1e-3)


@pytest.mark.parametrize("steps", [False, True], ids=["all", "differences pass"])
def test_settling_keeps_what_it_reached_where_no_further_step_has_an_equilibrium(monkeypatch, steps):
    cell = PeriodicCell(library.build("stockinette"), WOOL)
    rounds = []

    def late(strain, start):
        if len(rounds) < 2 or start is None:
            return False
        step = np.abs((strain.vector - start.strain.vector)[[0, 2]]).max()
        return not steps or step > 1.01 * DIFFERENCE

    failing(monkeypatch, late)
    found = shrunk_to_rest(cell, shortening=0.06, progress=rounds.append)
    assert found.status is RestStatus.NOT_RELAXED
    assert len(found.history) < 12
    np.testing.assert_allclose(found.pattern.period / cell.pattern.period, found.history[-1].stretch, rtol=1e-12)
    assert found.history[-1].stretch != (1.0, 1.0)
