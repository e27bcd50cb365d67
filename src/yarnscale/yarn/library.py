"""The patterns that yarnscale makes itself, by name."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import partial

from yarnscale.errors import InputError
from yarnscale.yarn.knit import knit
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.weave import basket_draft, plain_draft, satin_draft, twill_draft, weave

_RIB = {
    "wale_spacing": 8.5,
    "course_spacing": 5.0,
    "loop_height": 8.5,
    "overhang": 2.0,
    "half_thickness": 1.3,
}

BUILDERS: dict[str, Callable[..., YarnPattern]] = {
    "stockinette": partial(
        knit, ["k"], wale_spacing=8.0, course_spacing=4.5, loop_height=7.5, overhang=2.0, half_thickness=1.1
    ),
    "garter": partial(
        knit,
        ["k", "p"],
        wale_spacing=8.5,
        course_spacing=5.5,
        loop_height=8.5,
        overhang=2.2,
        half_thickness=1.4,
    ),
    "rib-1x1": partial(knit, ["kp"], **_RIB),
    "rib-2x2": partial(knit, ["kkpp"], **_RIB),
    "seed": partial(
        knit,
        ["kp", "pk"],
        wale_spacing=9.0,
        course_spacing=6.0,
        loop_height=9.5,
        overhang=2.2,
        half_thickness=1.4,
    ),
    "plain": partial(weave, plain_draft()),
    "basket-2x2": partial(weave, basket_draft(2)),
    "twill-2x2": partial(weave, twill_draft(2, 2)),
    "satin-5": partial(weave, satin_draft(5, 2)),
}
"""Pattern name -> builder; the sizes are in radii, found so that no two yarns overlap."""


def names() -> tuple[str, ...]:
    """Names of the built-in patterns."""
    return tuple(BUILDERS)


def build(name: str, **parameters: object) -> YarnPattern:
    """A built-in pattern; `parameters` are those of `knit.knit` or `weave.weave` (radius in metres).

    Raises InputError for an unknown name or parameter and for sizes that give no pattern.
    """
    if name not in BUILDERS:
        raise InputError("unknown pattern", expected=", ".join(BUILDERS), found=repr(name))
    allowed = parameter_names(name)
    for key in parameters:
        if key not in allowed:
            raise InputError(f"unknown parameter {key} of pattern {name}", expected=", ".join(allowed))
    return BUILDERS[name](**{"name": name, **parameters})


def parameter_names(name: str) -> tuple[str, ...]:
    """Parameters that `build` takes for a pattern."""
    if name not in BUILDERS:
        raise InputError("unknown pattern", expected=", ".join(BUILDERS), found=repr(name))
    signature = inspect.signature(BUILDERS[name].func)  # type: ignore[attr-defined]
    return tuple(key for key, value in signature.parameters.items() if value.kind is value.KEYWORD_ONLY)
