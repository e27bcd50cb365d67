"""Homogeneous fabric under loads against closed forms: linear fabric, isotropic sheets in any direction, two wells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.homogeneous.fabrics import MaterialFabric, Response
from yarnscale.homogeneous.loads import (
    FLAT,
    LoadedState,
    Loads,
    Prescribed,
    equilibrium_under,
    path_under,
)
from yarnscale.kinematics import line_stretch
from yarnscale.numerics.newton import Status
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial

SCALE = np.array([0.5] * 3 + [100.0] * 3)


@dataclass(frozen=True)
class Quadratic:
    """½ zᵀ M z + w(s_x), without moduli where s_x > ``mute``."""

    matrix: np.ndarray
    well: float = 0.0
    mute: float = np.inf
    refuses: float = np.inf
    strain_scale = SCALE

    def response(self, strain: np.ndarray, start: Response | None = None) -> Response:
        x = strain[0]
        energy = 0.5 * strain @ self.matrix @ strain + self.well * (x**4 - 0.02 * x**2)
        stress = self.matrix @ strain
        stress[0] += self.well * (4 * x**3 - 0.04 * x)
        return Response(np.array(strain), float(energy), stress, usable=bool(x < self.refuses))

    def moduli(self, response: Response) -> np.ndarray:
        x, moduli = response.strain[0], self.matrix.copy()
        if x > self.mute:
            raise ArithmeticError
        moduli[0, 0] += self.well * (12 * x**2 - 0.04)
        return moduli


def linear(**options: float) -> Quadratic:
    factor = np.random.default_rng(5).normal(size=(6, 6))
    return Quadratic((factor @ factor.T + 3 * np.eye(6)) / SCALE[:, None] / SCALE * 0.1, **options)


def test_line_stretch_is_the_length_of_the_material_line_and_has_its_derivatives() -> None:
    strain, angle, step = np.array([0.3, 0.2, -0.1, 5.0, 6.0, 7.0]), 0.7, 1e-6
    u = np.array([np.cos(angle), np.sin(angle)])
    a, shear, b = 1.3, 0.2, 0.9
    first = np.array([[a * a, shear * a * b], [shear * a * b, b * b]])
    value, slope, bend = line_stretch(strain, angle)
    assert value == pytest.approx(np.sqrt(u @ first @ u), rel=1e-14)
    for k in range(6):
        moved = step * np.eye(6)[k]
        ahead, behind = line_stretch(strain + moved, angle), line_stretch(strain - moved, angle)
        assert (ahead[0] - behind[0]) / (2 * step) == pytest.approx(slope[k], abs=1e-9)
        assert (ahead[1] - behind[1]) / (2 * step) == pytest.approx(bend[k], abs=1e-8)


def test_linear_fabric_with_held_strains_has_the_solution_of_its_equations() -> None:
    fabric = linear()
    held = Prescribed.components(s_a=0.05) + Prescribed(np.array([[0, 0, 0, 0.5, 1, 0.5]]), np.array([12.0]))
    loads = Loads.components(s_x=0.02, II11=1e-5)
    found = equilibrium_under(fabric, loads, prescribed=held, tolerance=1e-12)
    rows = held.matrix
    block = np.block([[fabric.matrix, rows.T], [rows, np.zeros((2, 2))]])
    expected = np.linalg.solve(block, np.concatenate([loads.stress, held.values]))[:6]
    assert found.converged
    assert rows @ found.strain == pytest.approx([0.05, 12.0], rel=1e-10)
    assert (found.strain - expected) / SCALE == pytest.approx(np.zeros(6), abs=1e-4)
    assert (found.moduli == fabric.matrix).all()


@pytest.mark.parametrize("angle", [0.0, 0.5, np.pi / 4, 2.0])
def test_isotropic_sheet_is_pulled_alike_in_every_direction(angle: float) -> None:
    k, coupling = 20.0, 6.0
    sheet = OrthotropicMaterial(k, coupling, k, (k - coupling) / 2, bend_weft=1e-5, bend_bias=1e-5, bend_warp=1e-5)
    young, poisson = (k**2 - coupling**2) / k, coupling / k
    loads = [Loads.tension(angle, load) for load in (0.1, 1.0, 5.0)]
    for load, found in zip((0.1, 1.0, 5.0), path_under(MaterialFabric(sheet), loads, tolerance=1e-9), strict=True):
        along, across = (line_stretch(found.strain, angle + turn)[0] for turn in (0.0, np.pi / 2))
        # St. Venant–Kirchhoff: P = λ Y (λ² − 1)/2, and E across is −ν times E along.
        assert found.converged
        assert along * young * (along**2 - 1) / 2 == pytest.approx(load, rel=1e-4)
        assert across**2 - 1 == pytest.approx(-poisson * (along**2 - 1), rel=1e-4)
        assert found.strain[3:] == pytest.approx(np.zeros(3), abs=1e-6)


def test_saddle_at_rest_is_left_for_a_well() -> None:
    fabric = Quadratic(np.diag(1 / SCALE**2), well=1000.0)
    found = equilibrium_under(fabric, Loads(), tolerance=1e-10)
    assert found.converged
    # 4 w x³ − 0.04 w x + x / 0.25 = 0
    assert abs(found.strain[0]) == pytest.approx(np.sqrt((40.0 - 4.0) / 4000.0), rel=1e-3)


class Noisy(Quadratic):
    """Energies known to a few digits only, as those of cells are."""

    def response(self, strain: np.ndarray, start: Response | None = None) -> Response:
        found = super().response(strain, start)
        return Response(found.strain, round(found.energy, 4), found.stress)


def test_residuals_of_a_saddle_are_no_measure_beyond_it() -> None:
    found = equilibrium_under(Noisy(np.diag(1 / SCALE**2), well=1000.0), Loads(), tolerance=1e-10)
    assert found.converged and abs(found.strain[0]) == pytest.approx(np.sqrt(36.0 / 4000.0), rel=1e-3)


def test_missing_moduli_do_not_stop_the_search_and_are_reported() -> None:
    visited: list[np.ndarray] = []
    fabric = linear(mute=0.02)
    found = equilibrium_under(
        fabric, Loads.components(s_x=0.3), prescribed=FLAT, observe=lambda _, moduli: visited.append(moduli)
    )
    assert found.converged
    assert found.strain[0] > 0.02 and np.isnan(found.moduli).all()
    assert np.isfinite(visited[0]).all() and len(visited) == found.evaluations


def test_fabric_that_gives_way_stalls_with_what_was_reached() -> None:
    found = equilibrium_under(linear(refuses=0.05), Loads.components(s_x=1.0), prescribed=FLAT)
    assert found.status in (Status.STALLED, Status.ITERATION_LIMIT)
    assert found.response.usable and 0.0 < found.strain[0] < 0.05
    assert found.residual > 0.1


def test_names_and_numbers_are_checked() -> None:
    with pytest.raises(InputError, match="s_z"):
        Loads.components(s_z=1.0)
    with pytest.raises(InputError, match="II21"):
        Prescribed.components(II21=1.0)
    with pytest.raises(InputError, match="finite"):
        Loads.tension(float("nan"), 1.0)


def test_a_start_without_moduli_is_gone_on_from():
    @dataclass(frozen=True, eq=False)
    class Remembering:
        """A quadratic energy that has moduli for its own responses only."""

        strain_scale = SCALE

        def response(self, strain, start=None):
            own = np.array(strain, float)
            return Response(own, 0.5 * float(own @ (own / SCALE**2)), own / SCALE**2, state="own")

        def moduli(self, response):
            assert response.state == "own"
            return np.diag(1 / SCALE**2)

    there = Response(np.zeros(6), 0.0, np.zeros(6), state="of another process")
    start = LoadedState(there, np.full((6, 6), np.nan), 0.0, Status.CONVERGED, 0)
    found = equilibrium_under(Remembering(), Loads.components(s_x=0.1), start=start)
    assert found.converged
    assert found.strain[0] == pytest.approx(0.1 * SCALE[0] ** 2, rel=1e-3)


def test_prescribed_strains_that_are_no_numbers_are_refused() -> None:
    with pytest.raises(InputError, match="finite"):
        Prescribed.components(II11=np.nan)
    with pytest.raises(InputError, match="matrix"):
        Prescribed(np.eye(6), np.zeros(2))
