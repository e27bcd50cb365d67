"""The model of a measured fabric's yarn: what is known, what is assumed, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from yarnscale.drawing.library import build
from yarnscale.errors import InputError, InputNotice
from yarnscale.files.estimate_run import DRAWN_RADIUS, estimate, fabric_model
from yarnscale.files.patterns import write_pattern
from yarnscale.swatches.measurements import Direction, StretchRun, StretchTest, SwatchMeasurements
from yarnscale.swatches.yarn_estimate import UNKNOWN_STIFFNESS
from yarnscale.swatches.yarn_model import drawn_length

RUN = StretchRun("1", np.array([0.0, 1.0, 2.0]), np.array([0.1, 0.11, 0.12]))
MEASURED = SwatchMeasurements("fabric", (StretchTest(Direction.WEFT, 0.05, (RUN,)),))


def test_sizes_and_stiffnesses_that_are_unknown_are_assumed_with_a_notice() -> None:
    with pytest.warns(InputNotice) as said:
        model = fabric_model(MEASURED, "plain")
    assert [str(notice.message).split(":")[0] for notice in said] == [
        "size of the fabric unknown", "stiffness of the yarn unknown",
    ]  # fmt: skip
    scale = DRAWN_RADIUS / build("plain").radius
    assert model.free_shape and model.stiffness == UNKNOWN_STIFFNESS
    assert model.pattern.period == pytest.approx(scale * build("plain").period)


def test_what_is_known_is_taken(tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    model = fabric_model(MEASURED, "plain", yarn_length=0.02, stiffness=30.0, free_shape=False)
    assert drawn_length(model.pattern) == pytest.approx(0.02) and model.stiffness == 30.0
    path = tmp_path / "plain.json"
    write_pattern(build("plain"), path)
    for source in (path, build("plain")):
        model = fabric_model(MEASURED, source, stiffness=30.0)
        assert not model.free_shape and model.pattern.period == pytest.approx(build("plain").period)
        with pytest.raises(InputError, match="radius"):
            fabric_model(MEASURED, source, radius=1e-3, stiffness=30.0)
    assert not recwarn.list
    with pytest.raises(InputError, match="yarn length"):
        fabric_model(MEASURED, "plain", radius=1e-3, yarn_length=0.02)


def test_there_must_be_something_to_resume(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nothing to resume"):
        estimate(MEASURED, fabric_model(MEASURED, build("plain"), stiffness=30.0), tmp_path, resume=True)
    assert list(tmp_path.iterdir()) == []
