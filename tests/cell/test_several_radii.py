"""Yarns of several radii in one pattern: stiffness, mass, contact and sensitivities follow each yarn's own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cell.periodic import PeriodicCell
from yarnscale.drawing.curves import PeriodicCurve, pattern_from_curves
from yarnscale.drawing.knit import knit
from yarnscale.drawing.weave import weave
from yarnscale.errors import InputError
from yarnscale.files.patterns import read_pattern, write_pattern
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.clearance import closest_approach
from yarnscale.yarn.material import ContactRule, YarnMaterial
from yarnscale.yarn.pattern import YarnPattern

WOOL = YarnMaterial.preset("wool")
RADII = np.array([1e-3, 4e-4])
CHECK = [[1, 0], [0, 1]]


def straight(gap: float) -> YarnPattern:
    """Two straight yarns along x, `gap` apart [m], one thick and one thin."""
    x = np.arange(8) * 1e-3
    curves = [PeriodicCurve(np.column_stack([x, 0 * x + y, 0 * x]), (1, 0)) for y in (0.0, gap)]
    return pattern_from_curves(curves, (8e-3, 2 * gap), 1e-3, yarn_radius=RADII)


def woven(**options: object) -> YarnPattern:
    return weave(CHECK, radius=4e-4, yarn_radius={"B": 7e-4}, weft_yarns="AB", **options)  # type: ignore[arg-type]


def test_stretch_and_mass_are_those_of_each_section() -> None:
    pattern = straight(5e-3)
    cell = PeriodicCell(pattern, WOOL)
    state = cell.relax(ShellStrain(s_x=0.02))
    sections = np.pi * (RADII**2).sum()
    assert state.stress[0] == pytest.approx(WOOL.young_modulus * sections * 0.02 / 1e-2, rel=1e-6)
    assert cell.area_density == pytest.approx(WOOL.density * sections / 1e-2, rel=1e-12)
    bent = cell.relax(ShellStrain(II11=20.0)).energy_density
    stiffness = WOOL.bending_scale * WOOL.young_modulus * np.pi / 4 * (RADII**4).sum()
    assert bent == pytest.approx(0.5 * stiffness * 20.0**2 / 1e-2, rel=2e-3)


def test_yarns_touch_at_the_sum_of_their_radii() -> None:
    for gap, touching in ((1.41e-3, False), (1.38e-3, True)):
        pattern = straight(gap)
        energy = PeriodicCell(pattern, WOOL).energy(ShellStrain())
        assert (energy.value(energy.start()) > 0.0) == touching
        assert closest_approach(pattern).distance / 2e-3 == pytest.approx(gap / RADII.sum(), rel=1e-9)


@pytest.mark.parametrize("rule", [ContactRule(), ContactRule("est2022")])
def test_sensitivities_follow_each_radius(rule: ContactRule) -> None:
    material = replace(WOOL, contact=rule)
    pattern = woven(vertices_per_stitch=6)
    state = PeriodicCell(pattern, material).with_options(tolerance=1e-10).relax(ShellStrain(s_x=0.05))
    found = PeriodicCell(pattern, material).sensitivities(state)
    for name in ("young_modulus", "bending_scale"):
        step = 1e-4 * getattr(material, name)
        energies = [
            PeriodicCell(pattern, replace(material, **{name: getattr(material, name) + sign * step}))
            .with_options(tolerance=1e-10)
            .relax(ShellStrain(s_x=0.05), start=state)
            .energy_density
            for sign in (1, -1)
        ]
        assert found.energy[name] == pytest.approx((energies[0] - energies[1]) / (2 * step), rel=1e-3)


def test_drawings_keep_room_for_every_radius() -> None:
    overshot = ["x.x.x.", "xxx...", ".x.x.x", "...xxx"]
    draft = [[int(symbol == "x") for symbol in row] for row in overshot]
    drawn = [
        woven(),
        weave(draft, radius=3e-4, weft_yarns="ABAB", yarn_radius={"B": 8e-4}),
        knit(["kk", "kt"], yarns=["a", "b"], yarn_radius={"b": 5e-4}),
        knit(["k"], yarns=["ab"], wale_spacing=10, course_spacing=6.5, radius=4e-4, yarn_radius={"b": 2e-4}),
    ]
    for pattern in drawn:
        assert pattern.yarn_radius is not None and pattern.radius == pattern.yarn_radius.max()
        assert closest_approach(pattern).distance > 0.85 * 2 * pattern.radius
    state = PeriodicCell(drawn[0], WOOL).relax()
    assert state.usable and 0.8 < state.min_distance_over_diameter < 1.0


def test_several_radii_are_part_of_the_pattern(tmp_path: Path) -> None:
    pattern = woven()
    write_pattern(pattern, tmp_path / "p.json")
    again = read_pattern(tmp_path / "p.json")
    assert again.content_hash() == pattern.content_hash()
    assert pattern.content_hash() != replace(pattern, yarn_radius=None).content_hash()
    assert pattern.scaled(2.0).yarn_radius == pytest.approx(np.array([8e-4, 14e-4, 8e-4, 8e-4]))
    tiles = pattern.repeated(2, 1)
    assert tiles.yarn_radius is not None and np.count_nonzero(tiles.yarn_radius == 7e-4) == 1
    single, double = (PeriodicCell(p, WOOL).relax(ShellStrain(s_x=0.05)).energy_density for p in (pattern, tiles))
    assert double == pytest.approx(single, rel=1e-5)
    alike = weave(CHECK, radius=4e-4, yarn_radius={"a": 4e-4})
    assert alike.yarn_radius is None and alike.content_hash() == weave(CHECK, radius=4e-4).content_hash()
    with pytest.raises(InputError, match="several yarn radii"):
        write_pattern(replace(pattern, yarn_material=None), tmp_path / "p.pyp")
    with pytest.raises(InputError, match="radius must be the largest of yarn_radius"):
        replace(pattern, radius=1e-3)
    with pytest.raises(InputError, match="radius_C belongs to no yarn"):
        weave(CHECK, yarn_radius={"C": 1e-3})
