"""Checks of the yarn radius against the pattern's loops and against usual sizes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from yarnscale.errors import InputError, notify
from yarnscale.yarn.clearance import closest_approach
from yarnscale.yarn.pattern import YarnPattern

_COMMON_RADIUS, _POSSIBLE_RADIUS = (2e-5, 3e-3), (1e-6, 0.05)
"""Radii of yarns [m]: reported outside the first, refused outside the second."""
_DENSE, _DENSEST = 5.0, 9.0
"""Area of the yarns seen from above over that of the period: 1.2 to 2.3 in fabrics of one or two layers."""
_OPEN = 0.3
"""Below this cover the pattern is checked for yarns that do not touch."""
_APART, _FAR_APART = 3.0, 8.0
"""Smallest distance between centre lines over the diameter: 0.9 to 1 where yarns touch."""


def check_proportions(pattern: YarnPattern, *, where: object = None) -> None:
    """Report a yarn radius that is unusual or does not fit its pattern; InputError if it is impossible."""
    try:
        for text in list(_unusual(pattern)):
            notify(text if where is None else f"{where}: {text}")
    except InputError as error:
        raise error.at(where) from None


def _unusual(pattern: YarnPattern) -> Iterator[str]:
    radius, period = pattern.radius, pattern.period
    sizes = f"radius {1e3 * radius:.4g} mm, period {1e3 * period[0]:.4g} × {1e3 * period[1]:.4g} mm"
    low, high = _POSSIBLE_RADIUS
    if not low <= radius <= high:
        expected = f"{1e3 * low:g} to {1e3 * high:g} mm, with all lengths in metres"
        raise InputError("radius of the yarn", expected=expected, found=sizes)
    if not _COMMON_RADIUS[0] <= radius <= _COMMON_RADIUS[1]:
        yield f"the yarn is of an unusual size: {sizes}"
    cover = 2.0 * radius * float(pattern.rest_length.sum()) / float(period.prod())
    if cover > _DENSEST:
        raise InputError(
            "radius of the yarn", expected="a yarn that fits into its period",
            found=f"{sizes}, where yarns lie {cover:.3g} times on each other",
        )  # fmt: skip
    if cover > _DENSE:
        yield f"yarns lie {cover:.3g} times on each other: {sizes}"
    if cover < _OPEN:
        # Neighbouring parts of one yarn are always close.
        reach = 3.0 * _FAR_APART * radius
        apart = closest_approach(pattern, within=reach, own=reach).distance / (2.0 * radius)
        found = f"{sizes}; centre lines are {apart:.3g} diameters apart or more"
        if apart > _FAR_APART and not _parallel(pattern):
            raise InputError("radius of the yarn", expected="yarns that touch each other", found=found)
        if apart > _APART:
            yield f"yarns do not touch: {found}"


def _parallel(pattern: YarnPattern) -> bool:
    """Whether all yarns are straight and parallel, so that their distance is arbitrary."""
    laps = pattern.yarn_shift * pattern.period
    straight = np.linalg.norm(laps, axis=1).sum() > 0.98 * float(pattern.rest_length.sum())
    turned = laps[0, 0] * laps[:, 1] - laps[0, 1] * laps[:, 0]
    return bool(straight and (np.abs(turned) < 1e-9 * (laps[0] ** 2).sum()).all())
