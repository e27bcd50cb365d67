"""Built-in patterns by name."""

from __future__ import annotations

import inspect
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Any

import numpy as np

from yarnscale.checked import checked
from yarnscale.drawing.knit import knit
from yarnscale.drawing.weave import basket_draft, herringbone_draft, plain_draft, satin_draft, twill_draft, weave
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


def _structure(definition: str, draft: Sequence[str] = (), chart: Sequence[str] = (), **others: Any) -> Structure:
    """An entry of ``patterns.toml``."""
    over = np.array([[symbol == "x" for symbol in row] for row in draft], dtype=int) if draft else None
    return Structure(definition, tuple(chart), over, **others)


PATTERNS = files("yarnscale") / "drawing" / "patterns.toml"
STRUCTURES: dict[str, Structure] = {
    name: _structure(**entry) for name, entry in tomllib.loads(PATTERNS.read_text(encoding="utf-8")).items()
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
