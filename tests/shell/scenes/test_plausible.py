"""Sizes, masses, thicknesses and ways that cannot be meant are refused; unusual ones are reported; others pass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.motion.handles import Handle
from yarnscale.motion.obstacles import MeshObstacle, Plane, Sphere
from yarnscale.motion.rigid import Motion
from yarnscale.shell.contact.cloth_contact import ContactSettings
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
from yarnscale.shell.mesh import rectangle
from yarnscale.shell.scenes.plausible import cloth_notices, size_notices, sizes_line

PANEL = rectangle(0.3, 0.2, 0.02)


def cloth(density: float = 0.15, **fields: object) -> Cloth:
    material = OrthotropicMaterial(
        stretch_weft=400.0, stretch_coupling=40.0, stretch_warp=600.0, shear=60.0, bend_weft=2e-6, bend_bias=2e-6,
        bend_warp=4e-6, density=density,
    )  # fmt: skip
    return Cloth(PANEL, material, **fields)  # type: ignore[arg-type]


def moved(*ways: float, duration: float = 1.0) -> tuple[Handle, ...]:
    motions = [Motion((way, 0, 0), duration=duration) for way in ways]
    return tuple(Handle(f"h{k}", np.array([k]), np.zeros((1, 3)), motion) for k, motion in enumerate(motions))


def body(size: float) -> MeshObstacle:
    return MeshObstacle(size * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))


def test_sizes_are_in_centimetres_and_grams() -> None:
    text = sizes_line(cloth())
    assert text == "fabric 30 × 20 cm, 600 cm²; in space 30 × 20 × 0 cm, 600 cm²; 9 g"


@pytest.mark.parametrize(
    "usual",
    [
        {},
        {"density": 0.6, "gravity": (0.0, 0.0, 0.0)},
        {"contact": ContactSettings(thickness=0.004)},
        {"handles": moved(0.0, 1.2)},
        {
            "contact": ContactSettings(),
            "obstacles": (Sphere((0, 0, 0), 0.07), Plane((0, 0, -90), (0, 0, 1)), body(2)),
        },
    ],
)
def test_what_is_common_passes(usual: dict[str, object]) -> None:
    assert [*cloth_notices(cloth(**usual))] == []  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("unusual", "words"),
    [
        ({"density": 15.0}, "density of the material"),
        ({"contact": ContactSettings(thickness=0.015)}, "repels itself"),
        ({"gravity": (0.0, -200.0, 0.0)}, "times that of the earth"),
        ({"handles": moved(9.0, 9.0)}, "handle 'h0' moves by"),
        ({"handles": moved(0.0, 3.0)}, "against each other"),
        ({"handles": moved(1.0, duration=0.01)}, "moves at 100 m/s"),
        ({"contact": ContactSettings(pressure=1e5)}, "times the weight of the cloth per area"),
        ({"contact": ContactSettings(), "obstacles": (body(40.0),)}, "another size"),
    ],
)
def test_what_is_unusual_is_reported(unusual: dict[str, object], words: str) -> None:
    notices = [*cloth_notices(cloth(**unusual))]  # type: ignore[arg-type]
    assert notices and words in notices[0]


@pytest.mark.parametrize(
    ("absurd", "message"),
    [
        ({"density": 150.0}, "density of the material; expected at most 50"),
        ({"contact": ContactSettings(thickness=1.0)}, "thickness of the contact; expected .* found 1000 mm"),
        ({"gravity": (0.0, 0.0, -9810.0)}, "gravity; expected at most 500 times"),
        ({"handles": moved(50.0)}, "displacement of handle 'h0'; expected at most 100 times"),
        (
            {"contact": ContactSettings(), "obstacles": (body(1700.0),)},
            "obstacle; expected .* found 1.7e.05 cm",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(absurd: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        list(cloth_notices(cloth(**absurd)))  # type: ignore[arg-type]


def test_a_size_of_another_unit_is_refused_with_units_that_fit() -> None:
    assert [*size_notices(PANEL, 0.15)] == []
    large = rectangle(30.0, 20.0, 2.0)
    with pytest.raises(InputError, match=r"2 mm|0.002 to 20 m, .*unit = \"m\".*cm or inch would be common"):
        list(size_notices(large, 0.15))
    assert "unusual size" in next(iter(size_notices(rectangle(12.0, 2.0, 1.0), 0.15)))
    with pytest.raises(InputError, match="size of the fabric"):
        list(size_notices(replace(PANEL, material=PANEL.material / 300, assembled=PANEL.assembled / 300), 0.15))
