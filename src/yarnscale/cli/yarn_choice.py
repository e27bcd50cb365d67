"""The yarn of a command: that of ``--material``, of the pattern's file, or a default that is printed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from yarnscale.cli.console import print_status
from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.files.material_toml import read_yarn_material
from yarnscale.files.patterns import read_yarns
from yarnscale.yarn.material import PRESETS, YarnMaterial
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.stiffness import Materials, materials_of

KNIT_DEFAULT, WEAVE_DEFAULT = "hylc2020-stockinette", "hylc2020-basket"
"""Yarns of patterns without yarn materials, by their structure."""


@dataclass(frozen=True)
class YarnChoice:
    """Yarn materials of a pattern, their origin, and those that they replace.

    is_default: whether they are a default.
    """

    pattern: str
    materials: Materials
    origin: str
    replaced: Materials | None = None
    is_default: bool = False

    @property
    def summary(self) -> dict[str, str]:
        """Entries of the JSON output."""
        return {"material": material_names(self.materials), "material_from": self.origin}

    @property
    def friction(self) -> float | None:
        """Coefficient of the yarns; None where none says it. InputError where they differ in it."""
        return common_friction((material.contact.friction for material in _listed(self.materials)), self.pattern)

    @property
    def rubs(self) -> bool:
        """Whether some yarn is known to have friction."""
        return any(material.contact.friction for material in _listed(self.materials))

    def print_status(self) -> None:
        """One line on the console."""
        instead = "" if self.replaced is None else f", instead of {material_names(self.replaced)} that came with it"
        print_status(f"yarn of {self.pattern}: {material_names(self.materials)} ({self.origin}){instead}")


def material_names(materials: Materials) -> str:
    """Names of materials in one text."""
    return " + ".join(m.name for m in _listed(materials))


def common_friction(coefficients: Iterable[float | None], whose: str) -> float | None:
    """The one coefficient of some yarns; InputError where they differ."""
    own = list(dict.fromkeys(coefficients))
    if len(own) > 1:
        found = ", ".join("none" if one is None else f"{one:g}" for one in own)
        raise InputError(f"friction of the yarns of {whose}", expected="--friction, one for all", found=found)
    return own[0] if own else None


def same_yarns(one: Materials, other: Materials) -> bool:
    """Whether materials are equal in all but their names and their friction, of which samples have none."""

    def elastic(material: YarnMaterial) -> YarnMaterial:
        return replace(material, name="", contact=replace(material.contact, friction=None))

    return [elastic(m) for m in _listed(one)] == [elastic(m) for m in _listed(other)]


def yarn_for(
    source: str | Path, pattern: YarnPattern, asked: list[str] | None, *, kept: Materials | None = None
) -> YarnChoice:
    """The yarn of a pattern that was read from a source.

    asked: materials by name or file, one for all yarns or one for each number. kept: those stored with a run
    instead of the pattern's file. Names of files and patterns do not matter: a file without a yarn has the default of
    knits or of weaves. Raises InputError for materials that do not suit the pattern.
    """
    label = str(source)
    own = kept if kept is not None else read_yarns(source)
    if asked is not None:
        given = [read_yarn_material(name) for name in asked]
        chosen = given[0] if len(given) == 1 else materials_of(pattern, given)
        differs = own is not None and not same_yarns(chosen, own)
        return YarnChoice(label, chosen, "--material", own if differs else None)
    if own is not None:
        return YarnChoice(label, own, "of the file" if kept is None else "of the run")
    if isinstance(source, str) and source in library.names():
        preset = library.structure(source).material
        return YarnChoice(label, YarnMaterial.preset(preset), "default of this built-in pattern", is_default=True)
    name, kind = (WEAVE_DEFAULT, "weaves") if pattern.woven else (KNIT_DEFAULT, "knits")
    return YarnChoice(label, PRESETS[name], f"default of {kind}; --material takes another", is_default=True)


def _listed(materials: Materials) -> tuple[YarnMaterial, ...]:
    return (materials,) if isinstance(materials, YarnMaterial) else tuple(materials)
