"""What counts of a fabric say of its size, and forces in the wrong unit."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.files.estimate_run import fabric_model
from yarnscale.swatches.construction import KnownConstruction
from yarnscale.swatches.measurements import Direction, StretchRun, StretchTest, SwatchMeasurements
from yarnscale.swatches.yarn_model import drawn_length


def fabric(known: KnownConstruction | None = None, *, force: float = 5.0) -> SwatchMeasurements:
    stretch = np.linspace(0.0, 0.3, 7)
    run = StretchRun("1", force * stretch / 0.3, 0.1 * (1 + stretch))
    measured = SwatchMeasurements("knit", (StretchTest(Direction.WEFT, 0.05, (run,)),))
    return measured if known is None else measured.knowing(known)


@pytest.mark.parametrize(
    "known",
    [
        KnownConstruction(loop_length=2.9e-3),
        # 165 g/m² at 14 by 20 stitches a square centimetre leave 0.589 mg a stitch.
        KnownConstruction(wales=1400, courses=2000, yarn_count=0.165 / 2.8e6 / 2.9e-3, area_density=0.165),
    ],
)
def test_the_loop_length_fixes_the_size(known):
    model = fabric_model(fabric(known), "rib-1x1")
    assert drawn_length(model.pattern) == pytest.approx(2 * 2.9e-3)
    assert model.stitches == (2, 1) and model.stitch_area is None


def test_the_stitch_density_fixes_the_size_unless_that_changes_a_measured_stiffness():
    counted = KnownConstruction(wales=1400, courses=2000)
    model = fabric_model(fabric(counted), "stockinette")
    assert float(np.prod(model.pattern.period)) == pytest.approx(1 / 2.8e6)
    assert model.stitch_area == pytest.approx(1 / 2.8e6)
    assert fabric_model(fabric(counted), "stockinette", stiffness=3.0).stitch_area is None
    with pytest.raises(InputError, match="both"):
        fabric_model(fabric(KnownConstruction(wales=1400)), "stockinette")


@pytest.mark.parametrize(("force", "words"), [(900.0, "grams taken for newtons"), (0.03, "newtons taken for grams")])
def test_forces_in_the_wrong_unit_are_told(force, words):
    with pytest.raises(InputError, match=words):
        fabric_model(fabric(force=force), "stockinette")
