"""The shell fit: known constants come back from synthetic swatches, and real knits are fitted within EST22's errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.files.measurements import read_measurements
from yarnscale.shell.materials.orthotropic import BENDING, DirectionalMaterial, OrthotropicMaterial
from yarnscale.shell.materials.stiffening import StiffeningMaterial
from yarnscale.swatches.bend_fit import fit_bending
from yarnscale.swatches.cloth_check import check_cloth
from yarnscale.swatches.fabric_shell import fit_shell
from yarnscale.swatches.measurements import (
    BendTest,
    BiaxialTest,
    Direction,
    StretchRun,
    StretchTest,
    SwatchMeasurements,
)
from yarnscale.swatches.membrane_constants import (
    AlongCurve,
    Scales,
    orthotropic_unknowns,
    stiffening_unknowns,
)
from yarnscale.swatches.pear_loop import PearLoop
from yarnscale.swatches.shell_fit import fit_membrane
from yarnscale.swatches.swatch import StretchSwatch
from yarnscale.swatches.uniaxial import biaxial_stress, uniaxial

KNOWN = OrthotropicMaterial(
    60.0, 20.0, 100.0, 25.0, area=10.0, log_area=5.0, bend_weft=2e-6, bend_bias=1.5e-6, bend_warp=6e-6
)


def stretched(
    material: DirectionalMaterial, directions: Sequence[Direction], *, noise: float = 0.0, width: bool = True
) -> SwatchMeasurements:
    """Synthetic stretch tests on the mesh of the fit, so that only the fit is tested."""
    random, stretch = np.random.default_rng(1), np.linspace(0.0, 0.3, 13)
    tests = []
    for direction in directions:
        swatch = StretchSwatch(direction, elements=6)
        response = swatch.respond(material, stretch[1:])
        runs = []
        for name in ("1", "2", "3"):
            force = np.append(0.0, response.force * (1 + noise * random.normal()))
            contraction = np.append(0.0, response.contraction * (1 + noise * random.normal()))
            across = 0.06 * (1 - contraction) if width else None
            runs.append(StretchRun(name, force, 0.1 * (1 + stretch), across))
        tests.append(StretchTest(direction, 0.06, tuple(runs)))
    return SwatchMeasurements("twin", tuple(tests))


@pytest.mark.parametrize("kind", [orthotropic_unknowns, stiffening_unknowns])
def test_the_jacobian_of_constants_by_unknowns_is_right(kind):
    curve = AlongCurve(50.0, 20.0, 5.0, 4.0, 0.4, 1.0)
    unknowns = kind(Scales(curve, curve))
    x = np.clip(unknowns.prior + 0.1, unknowns.low, unknowns.high)
    steps = 1e-6 * np.eye(len(x))
    columns = [(unknowns.constants(x + h) - unknowns.constants(x - h)) / 2e-6 for h in steps]
    np.testing.assert_allclose(unknowns.jacobian(x), np.column_stack(columns), rtol=1e-6, atol=1e-6)


def test_three_directions_give_back_the_known_constants():
    fit = fit_membrane(stretched(KNOWN, tuple(Direction)), model="stvk", largest_load=np.inf, elements=6)
    for name in KNOWN.MEMBRANE:
        assert getattr(fit.material, name) == pytest.approx(getattr(KNOWN, name), rel=0.01), name
    assert fit.load_error < 1e-3
    assert fit.contraction_error is not None and fit.contraction_error < 1e-3
    assert fit.undetermined == ()


def test_noise_moves_curves_by_no_more_than_itself():
    fit = fit_membrane(stretched(KNOWN, tuple(Direction), noise=0.03), model="stvk", largest_load=np.inf, elements=6)
    for direction in Direction:
        stretch = np.linspace(0.05, 0.3, 6)
        found, known = (uniaxial(m, direction.angle, stretch) for m in (fit.material, KNOWN))
        np.testing.assert_allclose(found[0], known[0], rtol=0.04)
        np.testing.assert_allclose(found[1], known[1], rtol=0.06)


def test_without_bias_the_shear_stiffness_is_called_undetermined_and_the_curves_are_right():
    fit = fit_membrane(
        stretched(KNOWN, (Direction.WEFT, Direction.WARP)), model="stvk", largest_load=np.inf, elements=6
    )
    assert "shear" in fit.undetermined and min(fit.resolution, key=fit.resolution.__getitem__) == "shear"
    for direction in (Direction.WEFT, Direction.WARP):
        stretch = np.linspace(0.05, 0.3, 6)
        np.testing.assert_allclose(
            uniaxial(fit.material, direction.angle, stretch)[0],
            uniaxial(KNOWN, direction.angle, stretch)[0],
            rtol=0.03,
        )


def test_biaxial_states_tell_coupling_and_stiffness_across():
    weft = stretched(KNOWN, (Direction.WEFT,), width=False)
    stretch = np.array([[0.1, 0.05], [0.05, 0.1], [0.1, 0.1], [0.2, 0.02], [0.02, 0.2], [0.15, 0.15]])
    both = replace(weft, biaxial=BiaxialTest(stretch, biaxial_stress(KNOWN, stretch)))
    fit = fit_membrane(both, model="stvk", largest_load=np.inf, states=2, elements=6)
    unseen = np.array([[0.12, 0.08], [0.06, 0.15], [0.0, 0.18]])
    np.testing.assert_allclose(biaxial_stress(fit.material, unseen), biaxial_stress(KNOWN, unseen), rtol=0.01)
    assert "stretch_warp" not in fit.undetermined


def test_a_fabric_that_stiffens_comes_back_with_both_contractions():
    """The polynomial of EST22 is a third off such swatches; resting stiffness, end stiffness and widths all differ."""
    known = StiffeningMaterial(
        8.0,
        20.0,
        3.0,
        6.0,
        6.0,
        9.0,
        2.0,
        -1.0,
        30.0,
        6.0,
        coupling=10.0,
        shear=5.0,
        shear_rate=1.0,
        log_area=0.1,
    )
    fabric = stretched(known, (Direction.WEFT, Direction.WARP))
    fit = fit_membrane(fabric, largest_load=np.inf, elements=6)
    assert fit.load_error < 0.01
    assert fit.contraction_error is not None and fit.contraction_error < 0.02
    stretch = np.linspace(0.05, 0.3, 6)
    for direction in (Direction.WEFT, Direction.WARP):
        found, true = (uniaxial(m, direction.angle, stretch) for m in (fit.material, known))
        np.testing.assert_allclose(found[0], true[0], rtol=0.05)
        np.testing.assert_allclose(found[1], true[1], rtol=0.05)


def test_force_alone_is_fitted_too():
    fit = fit_membrane(
        stretched(KNOWN, (Direction.WEFT, Direction.WARP), width=False),
        model="stvk",
        largest_load=np.inf,
        elements=6,
    )
    assert fit.contraction_error is None
    assert fit.load_error < 0.01
    assert not fit.assumed_contraction


def test_a_force_that_stiffens_much_does_not_lead_to_an_impossible_contraction():
    """EST22's shell does not stiffen like that; without widths, clamps were blamed for half of the force."""
    stretch = np.linspace(0.0, 0.8, 17)
    tests = []
    for direction, factor in ((Direction.WEFT, 1.0), (Direction.WARP, 2.2)):
        force = 0.35 * (np.exp(4.0 * stretch) - 1.0)
        runs = tuple(StretchRun(name, force, 0.1 * (1 + stretch / factor)) for name in "12")
        tests.append(StretchTest(direction, 0.05, runs))
    fabric = SwatchMeasurements("jersey", tuple(tests))
    shell = fit_shell(fabric, model="stvk")
    assert shell.membrane.assumed_contraction
    for curve, test in zip(shell.uniform_data(follow="measured").curves, tests, strict=True):
        assert (curve.stress > 0.85 * test.curve.load_at(curve.stretch)).all()


def test_loops_give_back_the_known_bending():
    distances, tests = np.array([0.004, 0.018, 0.034]), []
    for direction in Direction:
        ratio = PearLoop(direction, segments=15).respond(KNOWN, distances).ratio
        tests.append(BendTest(direction, 0.1, 0.06, distances, ratio))
    fabric = SwatchMeasurements("twin", bend=tuple(tests), area_density=KNOWN.density)
    fit = fit_bending(fabric, KNOWN, segments=15)
    for name in BENDING:
        assert getattr(fit.material, name) == pytest.approx(getattr(KNOWN, name), rel=0.01), name
    assert fit.error < 1e-3


def test_missing_tests_are_named():
    fabric = stretched(KNOWN, (Direction.WEFT,))
    with pytest.raises(InputError, match="bend test"):
        fit_bending(fabric, KNOWN)
    loops = BendTest(Direction.WEFT, 0.1, 0.06, np.array([0.01]), np.array([2.0]))
    with pytest.raises(InputError, match="stretch test"):
        fit_shell(SwatchMeasurements("loops", bend=(loops,), area_density=0.2))


def test_a_real_knit_is_fitted_within_the_average_errors_of_the_paper(shared):
    fabric = read_measurements(shared / "measured" / "acrylic_uniaxial.csv", sample="Acrylic Yarn Stockinette")
    shell = fit_shell(fabric, model="stvk")
    assert shell.membrane.load_error < 0.1759
    assert shell.membrane.contraction_error is not None and shell.membrane.contraction_error < 0.1684
    data = shell.uniform_data()
    assert [curve.direction for curve in data.curves] == [Direction.WEFT, Direction.WARP]
    own = data.errors([c.stress for c in data.curves], [c.contraction for c in data.curves])
    assert own.comfort == own.full == own.compression == 0.0
    measured = shell.uniform_data(follow="measured")
    apart = data.errors([c.stress for c in measured.curves], [c.contraction for c in measured.curves])
    assert 0 < apart.comfort < 0.15 and 0 < apart.full < 0.15


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "sample"),
    [("cases/test-logs/j-shaped.csv", None), ("measured/acrylic_uniaxial.csv", "Acrylic Yarn Rib")],
)
def test_fabrics_that_stiffen_are_followed_within_five_percent(shared, file, sample):
    fabric = read_measurements(shared / file, sample=sample)
    errors = check_cloth(fit_shell(fabric).material, fabric).errors
    assert errors.comfort < 0.05 and errors.full < 0.05
