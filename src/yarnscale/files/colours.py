"""Colours of cloth, bodies and yarns in files, linear as USD and glTF have them."""

from __future__ import annotations

YARNS = ("#2a6fa8", "#d9653b", "#e8b13d", "#2f9e8a", "#a267ac", "#7a8794")
"""Yarn colours in order of use, as on screens; neighbours differ in lightness as well as in hue."""
_OTHERS = {"cloth": (0.69, 0.26, 0.12), "bodies": (0.55, 0.60, 0.65)}


def yarn_name(number: int) -> str:
    """Name of the material of yarns of a number."""
    return "yarns" if number == 0 else f"yarns{number}"


def colour_of(name: str) -> tuple[float, float, float]:
    """Linear red, green and blue of ``cloth``, ``bodies``, or yarns by their name."""
    return _OTHERS[name] if name in _OTHERS else linear_yarn_colour(int(name.removeprefix("yarns") or 0))


def linear_yarn_colour(number: int) -> tuple[float, float, float]:
    """Linear red, green and blue of yarns of a number."""
    code = YARNS[number % len(YARNS)]
    red, green, blue = (_linear(int(code[k : k + 2], 16) / 255.0) for k in (1, 3, 5))
    return red, green, blue


def _linear(value: float) -> float:
    """Of a component of sRGB."""
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4
