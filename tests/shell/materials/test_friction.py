"""Friction of a shell material: derivatives, rate independence, dissipation, limits, and its cycles."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.homogeneous.fabrics import MaterialFabric
from yarnscale.homogeneous.histories import history_of, under_loads
from yarnscale.homogeneous.loads import FLAT, Loads, Prescribed, equilibrium_under
from yarnscale.shell.materials.compact import MIRROR, CompactMaterial, SpringNetwork, shapes_of
from yarnscale.shell.materials.friction import ROUNDING, Sliders
from yarnscale.shell.materials.history import MaterialHistory

SCALE = np.array([0.5, 0.5, 0.5, 100.0, 100.0, 100.0])


def material(sliders: Sliders | None) -> CompactMaterial:
    """A quadratic energy of 4 x² with sliders, whose directions may turn by a step."""
    none = SpringNetwork(*(np.zeros(tuple(shape)) for shape in shapes_of(1, 1, 1)))
    steps = {"steps": np.array([[3.0, 2.0, -1.0, 0.5, 1.0, 0.0]]), "step_offsets": np.array([0.2])}
    springs = none._replace(background=np.full(6, 8.0), **steps)
    return CompactMaterial(0.0, SCALE, springs, density=0.2, sliders=sliders)


def some_sliders(count: int = 5) -> Sliders:
    random = np.random.default_rng(3)
    directions, stiffnesses, growth = (
        random.normal(size=(count, 6)), random.uniform(1, 20, count), random.uniform(0, 0.02, (2, count, 6)),
    )  # fmt: skip
    return Sliders.checked(
        directions, random.normal(size=(count, 1)), stiffnesses, random.uniform(0, 0.01, count), *growth
    )


def walk(steps: int, *, seed: int = 0, size: float = 0.05) -> np.ndarray:
    """A random path of strains that stays in a box."""
    random, here, found = np.random.default_rng(seed), np.zeros(6), []
    for _ in range(steps):
        here = np.clip(here + size * random.normal(size=6), -0.5, 0.5)
        found.append(here * SCALE)
    return np.array(found)


def followed(history: MaterialHistory, strains: np.ndarray) -> list[MaterialHistory]:
    found = []
    for strain in strains:
        history = history.after(strain)
        found.append(history)
    return found


def test_stress_and_moduli_of_a_step_are_derivatives_of_its_energy() -> None:
    history = followed(MaterialHistory.begin(material(some_sliders()), np.zeros(6)), walk(20))[-1]
    step = 1e-6 * SCALE
    for strain in history.strain + walk(5, seed=1):
        for k in range(6):
            away = np.eye(6)[k] * step
            slope = (history.energy_density(strain + away) - history.energy_density(strain - away)) / (2 * step[k])
            assert history.stress(strain)[k] * SCALE[k] == pytest.approx(slope * SCALE[k], abs=1e-6)
            bend = (history.stress(strain + away) - history.stress(strain - away)) / (2 * step[k])
            np.testing.assert_allclose(history.moduli(strain)[k] * SCALE * SCALE[k], bend * SCALE * SCALE[k], atol=1e-4)


@pytest.mark.parametrize("seed", [0, 1])
def test_random_paths_of_a_thousand_steps_lose_energy_in_every_step_and_stay_bounded(seed: int) -> None:
    """Work of the stress = change of the energy + what friction takes, within the error of the quadrature of work."""
    fabric, sliders = material(some_sliders()), some_sliders()
    found = followed(MaterialHistory.begin(fabric, np.zeros(6)), walk(1000, seed=seed))
    assert min(history.dissipated for history in found) >= -1e-12
    strain = np.array([history.strain for history in found])
    friction = np.array([history.force for history in found]) - fabric.stress(strain)
    pressure = np.abs(fabric.stress(strain) * SCALE).max()
    slopes = np.abs(sliders.directions) + np.abs(sliders.bends) @ np.abs(fabric.springs.steps)
    limits = sliders.rest + np.maximum(sliders.same_sign, sliders.other_sign).sum(axis=1) * pressure
    most = sliders.stiffnesses @ (slopes * limits[:, None])
    assert (np.abs(friction * SCALE) <= most).all()


def test_work_is_energy_and_dissipation() -> None:
    corners = walk(4, size=0.2)
    errors = []
    for parts in (40, 80):
        path = np.concatenate([np.linspace(a, b, parts + 1)[1:] for a, b in pairwise(corners)])
        start = MaterialHistory.begin(material(some_sliders()), corners[0])
        found = [start, *followed(start, path)]
        strain, stress = (np.array([getattr(h, n) for h in found]) for n in ("strain", "force"))
        work = (0.5 * (stress[1:] + stress[:-1]) * np.diff(strain, axis=0)).sum()
        lost = sum(h.dissipated for h in found)
        errors.append(abs(work - lost - (found[-1].stored - start.stored)) / lost)
    assert errors[1] < 0.02 and errors[1] < 0.7 * errors[0]


def plain(directions: np.ndarray, stiffnesses: np.ndarray, growth: np.ndarray, rest: float = 0.0) -> Sliders:
    """Sliders of constant directions, whose limits are the same on either side."""
    count = len(stiffnesses)
    return Sliders.checked(directions, np.zeros((count, 1)), stiffnesses, np.full(count, rest), growth, growth)


def one_slider(limit: float = 0.1) -> tuple[CompactMaterial, float]:
    """A slider along s_x of a spring of 50 J/m²; half of its limit depends on the stress of s_y, which stays."""
    pressed = 0.5
    growth = np.zeros((1, 6))
    growth[0, 2] = 0.5 * limit / (8.0 * pressed)
    return material(plain(np.eye(6)[:1], np.array([50.0]), growth, rest=0.5 * limit)), pressed


def test_a_small_cycle_sticks_and_a_large_one_loses_what_a_slider_takes() -> None:
    """Jenkins element: stiffness c while it sticks; a cycle of amplitude A takes 4 c y (A − y)."""
    fabric, pressed = one_slider()
    rest = np.array([0.0, 0.0, pressed, 0.0, 0.0, 0.0]) * SCALE

    def cycled(amplitude: float, steps: int = 400) -> list[MaterialHistory]:
        angle = np.linspace(0.0, 4.0 * np.pi, steps + 1)[1:]
        x = amplitude * np.sin(angle)
        return followed(MaterialHistory.begin(fabric, rest), rest + np.outer(x, np.eye(6)[0]) * SCALE)

    small = cycled(0.5 * 0.1 * (1 - ROUNDING))
    pull = np.array([(h.force - fabric.stress(h.strain))[0] * SCALE[0] for h in small])
    np.testing.assert_allclose(pull, [50.0 * h.strain[0] / SCALE[0] for h in small], atol=1e-9)
    assert sum(h.dissipated for h in small) == pytest.approx(0.0, abs=1e-12)
    large = cycled(0.4)
    loss = sum(h.dissipated for h in large[200:])
    assert loss == pytest.approx(4 * 50.0 * 0.1 * (0.4 - 0.1), rel=0.02)


def test_a_slider_holds_more_along_a_stress_than_against_it() -> None:
    """Stresses 8 x of either sign become 8 x (1 ± c h); a slider of the opposite direction has both exchanged."""
    along, against = 0.03, 0.01
    for sign in (1, -1):
        growth = [share * np.eye(6)[:1] for share in (along, against)[::sign]]
        fabric = material(Sliders.checked(sign * np.eye(6)[:1], np.zeros((1, 1)), [50.0], [0.0], *growth))
        for side in (1.0, -1.0):
            x = side * np.concatenate([np.linspace(0, 0.4, 801), np.linspace(0.4, 0.2, 401)[1:]])
            start = MaterialHistory.begin(fabric, np.zeros(6))
            found = followed(start, np.outer(x, np.eye(6)[0]) * SCALE)
            for history, share in ((found[800], 50.0 * along), (found[-1], -50.0 * against)):
                stress = 8.0 * history.strain[0] / SCALE[0]
                assert history.force[0] * SCALE[0] == pytest.approx((1.0 + share) * stress, rel=0.01)
            assert min(history.dissipated for history in found) >= -1e-12


def test_a_spring_that_sticks_does_not_creep() -> None:
    fabric, pressed = one_slider()
    held = np.array([0.07, 0.0, pressed, 0.0, 0.0, 0.0]) * SCALE
    rest = np.array([0.0, 0.0, pressed, 0.0, 0.0, 0.0]) * SCALE
    found = followed(MaterialHistory.begin(fabric, rest), np.repeat(held[None], 500, axis=0))
    np.testing.assert_allclose(found[-1].force, found[0].force, rtol=1e-12)


def test_loops_under_load_return_less_work_and_leave_a_stretch() -> None:
    sliders = plain(np.eye(6)[:1], np.array([30.0]), 0.02 * np.eye(6)[:1])
    fabric = material(sliders)
    history = history_of(fabric, None, FLAT)
    assert isinstance(history, MaterialHistory)
    lost, stretch = 0.0, []
    for load in [*np.linspace(0, 4, 41)[1:], *np.linspace(4, 0, 41)[1:]]:
        history = history.step(under_loads(Loads.tension(0.0, float(load)), FLAT))
        assert history is not None
        lost, stretch = lost + history.dissipated, [*stretch, history.strain[0]]
    assert lost > 0.01 * stretch[39] and stretch[-1] > 0.01 * stretch[39]
    loose = equilibrium_under(MaterialFabric(material(None)), Loads.tension(0.0, 4.0), prescribed=FLAT)
    assert stretch[39] < loose.strain[0]


def test_without_friction_there_is_no_history_and_with_none_moving_it_is_elastic() -> None:
    with pytest.raises(InputError, match="with friction"):
        history_of(material(None), None, Prescribed())
    idle = plain(np.eye(6), np.zeros(6), np.zeros((6, 6)))
    found = followed(MaterialHistory.begin(material(idle), np.zeros(6)), walk(10))
    elastic = material(None)
    for history in found:
        np.testing.assert_allclose(history.force, elastic.stress(history.strain), rtol=1e-13)
        assert history.dissipated == pytest.approx(0.0, abs=1e-13)


def test_the_mirror_image_of_a_path_has_the_mirrored_stress() -> None:
    fabric, path = material(some_sliders()), walk(30)
    found = followed(MaterialHistory.begin(fabric, np.zeros(6)), path)
    mirrored = followed(MaterialHistory.begin(fabric, np.zeros(6)), path * MIRROR)
    for one, other in zip(found, mirrored, strict=True):
        np.testing.assert_allclose(other.force * MIRROR * SCALE, one.force * SCALE, atol=1e-9)
        assert other.dissipated == pytest.approx(one.dissipated, abs=1e-12)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"stiffnesses": [-1.0]}, "stiffnesses"),
        ({"same_sign": [[np.nan] * 6]}, "same_sign"),
        ({"other_sign": [[-0.1] * 6]}, "other_sign"),
        ({"directions": [1.0]}, "directions"),
        ({"rest": [-0.1]}, "rest"),
    ],
)
def test_sliders_that_do_not_match_are_refused(change: dict, field: str) -> None:
    good = {
        "directions": [[1.0] * 6], "bends": [[0.0]], "stiffnesses": [1.0], "rest": [0.1], "same_sign": [[0.0] * 6],
        "other_sign": [[0.0] * 6],
    }  # fmt: skip
    with pytest.raises(InputError, match=f"friction {field}"):
        Sliders.checked(*(good | change).values())


def test_a_copy_keeps_its_friction() -> None:
    assert replace(material(some_sliders()), density=0.1).sliders is not None
