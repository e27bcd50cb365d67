"""Built-in patterns by name."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from yarnscale.checked import checked
from yarnscale.drawing.knit import knit
from yarnscale.drawing.weave import (
    basket_draft,
    herringbone_draft,
    plain_draft,
    satin_draft,
    twill_draft,
    weave,
)
from yarnscale.errors import InputError, misspelt
from yarnscale.yarn.pattern import YarnPattern


@dataclass(frozen=True, eq=False)
class Structure:
    """How a built-in pattern is made.

    definition: what the structure is, in a sentence or two. chart: rows of stitches, the first knitted first
    (see `stitches`); draft: of a weave, 1 where the warp is over the weft; one of them. sizes: parameters of
    `knit.knit` or `weave.weave` (spacings in radii) at which no two yarns overlap. material: a suitable preset,
    the published one if there is one.
    """

    definition: str
    chart: tuple[str, ...] = ()
    draft: np.ndarray | None = None
    sizes: Mapping[str, Any] = field(default_factory=dict)
    material: str = "hylc2020-stockinette"

    @property
    def woven(self) -> bool:
        """Whether it is a weave."""
        return self.draft is not None

    @property
    def maker(self) -> Callable[..., YarnPattern]:
        """`knit.knit` or `weave.weave`."""
        return weave if self.woven else knit

    def build(self, **parameters: object) -> YarnPattern:
        """The pattern; parameters replace the structure's own sizes."""
        source = self.chart if self.draft is None else self.draft
        return self.maker(source, **{**self.sizes, **parameters})


def _sizes(wale: float, course: float, **others: float) -> dict[str, float | str]:
    return {"wale_spacing": wale, "course_spacing": course, **others}


_STOCKINETTE = _sizes(8.0, 4.5, loop_height=7.5, overhang=2.0, half_thickness=1.1)
_GARTER = _sizes(8.5, 5.5, loop_height=8.5, overhang=2.2, half_thickness=1.4)
_RIB = _sizes(8.5, 5.0, loop_height=8.5, overhang=2.0, half_thickness=1.3)
_SEED = _sizes(9.0, 6.0, loop_height=9.5, overhang=2.2, half_thickness=1.4)
_SMALL: dict[str, float | str] = {"radius": 1e-4, "rest_shape": "current"}

STRUCTURES: dict[str, Structure] = {
    "stockinette": Structure(
        "Knit stitches only: all loops drawn to the right side.", ("k",), sizes=_STOCKINETTE
    ),
    "stockinette-small": Structure(
        "Stockinette of a yarn of 0.1 mm radius, set in the drawn shape.",
        ("k",),
        sizes={**_STOCKINETTE, **_SMALL},
        material="hylc2020-stockinette-small",
    ),
    "single-jersey": Structure(
        "Plain fabric of one needle bed, as stockinette, with the taller loops of machine-knit jersey.",
        ("k",),
        sizes=_sizes(8.0, 5.5, loop_height=9.0, overhang=2.0, half_thickness=1.2),
    ),
    "jersey": Structure(
        "Stockinette in the open proportions of hand-knit jersey, as bounding volumes were published with.",
        ("k",),
        sizes=_sizes(9.0, 6.0, half_thickness=1.1),
    ),
    "garter": Structure("Courses of knit and of purl stitches in turn.", ("k", "p"), sizes=_GARTER),
    "links": Structure(
        "1×1 links-links (purl) fabric: in every wale face and reverse loops alternate, whole courses at a time. "
        "Garter stitch, drawn closer in the course direction as it leaves the machine.",
        ("k", "p"),
        sizes=_sizes(8.5, 5.0),
    ),
    "rib-1x1": Structure("Wales of knit and of purl stitches in turn.", ("kp",), sizes=_RIB),
    "rib-2x2": Structure("Two wales of knit, two of purl stitches in turn.", ("kkpp",), sizes=_RIB),
    "seed": Structure("Knit and purl stitches in a chequerboard.", ("kp", "pk"), sizes=_SEED),
    "moss": Structure(
        "Double moss: a chequerboard of knit and purl stitches two courses high.",
        ("kp", "kp", "pk", "pk"),
        sizes=_SEED,
    ),
    "honeycomb": Structure(
        "Slip-stitch honeycomb: knit courses, and between them purl courses in which every other stitch is slipped "
        "with the float in front, offset by one stitch from one such course to the next (worked flat: right-side "
        "rows knit, wrong-side rows k1, slip 1 with the yarn in back).",
        ("kk", "pf", "kk", "fp"),
        sizes=_sizes(9.0, 5.0),
        material="hylc2020-honeycomb",
    ),
    "cartridge-belt-rib": Structure(
        "Over four stitches, every course slips one: k3, slip 1 with the float in front; then, from the wrong "
        "side, the same two stitches further on, so that plain wales of slipped knit and of slipped purl stitches "
        "alternate between garter wales and both sides look alike.",
        ("kkkf", "pbpp"),
        sizes=_sizes(8.5, 4.5),
        material="hylc2020-rib",
    ),
    "all-needle": Structure(
        "All-needle rib: both beds knit on every needle in every course; the back needles stand between the front "
        "ones, so closely that the wales of the two sides overlap.",
        ("k|p",),
        sizes=_sizes(5.5, 4.5),
    ),
    "interlock": Structure(
        "Two 1×1 ribs knitted through each other: needles face each other, one course knits odd front and even "
        "back needles, the next the others.",
        ("k-|-p", "-k|p-"),
        sizes=_sizes(4.5, 3.2, tightness=0.95),
    ),
    "double-pique": Structure(
        "Double piqué: a rib course on all front and every other back needle, then a course on the other back "
        "needles alone; then both again with the back needles changed over. Back loops are held for two courses.",
        ("kk|p-", "--|-p", "kk|-p", "--|p-"),
        sizes=_sizes(5.5, 3.5),
    ),
    "half-cardigan": Structure(
        "Rib in which the back bed tucks in every other course, while the front bed knits in all.",
        ("k|p", "k|t"),
        sizes=_sizes(6.0, 4.5),
    ),
    "full-cardigan": Structure(
        "Rib in which one bed knits and the other tucks, changing over from course to course.",
        ("k|t", "t|p"),
        sizes=_sizes(6.5, 4.5),
    ),
    "plain": Structure("Over one, under one.", draft=plain_draft(), material="hylc2020-basket"),
    "basket-2x2": Structure(
        "Plain weave of pairs of yarns.", draft=basket_draft(2), material="hylc2020-basket"
    ),
    "twill-2x2": Structure(
        "Warp over two picks, under two, one end further in every pick.",
        draft=twill_draft(2, 2),
        material="hylc2020-basket",
    ),
    "twill-2x1": Structure(
        "Warp over two picks, under one: warp-faced twill of three.",
        draft=twill_draft(2, 1),
        material="hylc2020-basket",
    ),
    "twill-3x1": Structure(
        "Warp over three picks, under one: warp-faced twill of four.",
        draft=twill_draft(3, 1),
        material="hylc2020-basket",
    ),
    "herringbone": Structure(
        "2/2 twill whose diagonals turn after every four ends; at the cuts neighbouring ends lie opposite.",
        draft=herringbone_draft(2, 2, 4),
        material="hylc2020-basket",
    ),
    "satin-5": Structure(
        "Satin of five with move two (or three, from the other side): every end dives under one pick in five.",
        draft=satin_draft(5, 2),
        material="hylc2020-satin",
    ),
    "satin-small": Structure(
        "Satin of five of a yarn of 0.1 mm radius, set in the drawn shape.",
        draft=satin_draft(5, 2),
        sizes=_SMALL,
        material="hylc2020-satin-small",
    ),
}
"""Pattern name -> how it is made."""


def names() -> tuple[str, ...]:
    """Names of the built-in patterns."""
    return tuple(STRUCTURES)


def structure(name: str) -> Structure:
    """How a built-in pattern is made; InputError for an unknown name."""
    if name not in STRUCTURES:
        raise InputError("unknown pattern", expected=", ".join(STRUCTURES), found=misspelt(name, STRUCTURES))
    return STRUCTURES[name]


@checked
def build(name: str, **parameters: object) -> YarnPattern:
    """A built-in pattern; `parameters` are those of `knit.knit` or `weave.weave` (radius in metres).

    Raises InputError for an unknown name or parameter and for impossible sizes.
    """
    made = structure(name)
    allowed = parameter_names(name)
    for key in parameters:
        if key not in allowed:
            raise InputError(f"unknown parameter {key} of pattern {name}", expected=", ".join(allowed))
    return made.build(**{"name": name, **parameters})


def parameter_names(name: str) -> tuple[str, ...]:
    """Parameters that `build` takes for a pattern."""
    signature = inspect.signature(structure(name).maker)
    return tuple(key for key, value in signature.parameters.items() if value.kind is value.KEYWORD_ONLY)


__all__ = [
    "STRUCTURES", "Structure", "basket_draft", "build", "herringbone_draft", "names", "parameter_names", "plain_draft",
    "satin_draft", "structure", "twill_draft",
]  # fmt: skip


def __dir__() -> list[str]:
    return __all__
