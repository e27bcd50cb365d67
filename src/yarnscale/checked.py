"""Wrong arguments fail at once: what a public function is given is compared with the classes that it names."""

from __future__ import annotations

import functools
import inspect
import numbers
import os
import types
from collections.abc import Callable
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from yarnscale.errors import InputError

Target = TypeVar("Target", bound=Callable[..., Any])

WIDER: dict[object, tuple[type, ...]] = {
    float: (numbers.Real,),
    int: (numbers.Integral,),
    str: (str,),
    os.PathLike: (os.PathLike,),
    Path: (str, os.PathLike),
}
"""Plain types of annotations, and what is taken for them."""
MAKERS = {
    "YarnPattern": "read_pattern or patterns.build makes one",
    "YarnMaterial": "YarnMaterial.preset or read_yarn_material makes one",
    "PeriodicCell": "PeriodicCell(pattern, material) makes one",
    "Start": "an Equilibrium is one",
    "ShellStrain": "ShellStrain(s_x=0.1) makes one",
    "ShellMaterial": "read_material reads one",
    "Scene": "scenes.stretch and others make one",
    "SimulatedScene": "scenes.stretch, RodScene and others make one",
    "RodFabric": "RodFabric.cut and others make one",
    "SampleStore": "create_store makes one",
    "SwatchMeasurements": "read_measurements makes one",
}


class WrongArgument(InputError, TypeError):
    """An argument of another type than the function takes, or one too many or too few."""


def checked(target: Target) -> Target:
    """A function that compares its arguments with its annotations; of a class, its ``__init__`` does so.

    Classes, numbers, texts and unions of them are compared; arrays, sequences and protocols are the function's own
    business. Raises WrongArgument with the argument, the expected type and what was found.
    """
    if isinstance(target, type):
        target.__init__ = _checked(target.__init__, target.__name__, target)  # type: ignore[misc]
        return target  # type: ignore[return-value]
    return _checked(target, target.__name__)


def _checked(function: Any, name: str, owner: type | None = None) -> Any:
    signature = inspect.signature(function)

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        try:
            given = signature.bind(*args, **kwargs).arguments
        except TypeError as error:
            raise WrongArgument(f"{name}: {error}", expected=_usage(signature)) from None
        for argument, kinds in _kinds(function, owner).items():
            if argument in given and not isinstance(given[argument], kinds):
                raise _fault(name, argument, kinds, given[argument])
        return function(*args, **kwargs)

    return call


def _usage(signature: inspect.Signature) -> str:
    return ", ".join(name for name in signature.parameters if name != "self")


def _fault(name: str, argument: str, kinds: tuple[type, ...], found: object) -> WrongArgument:
    names = list(dict.fromkeys(_name(kind) for kind in kinds if kind is not type(None)))
    made = [MAKERS[kind] for kind in names if kind in MAKERS]
    expected = " or ".join(names) + (f" ({made[0]})" if made else "")
    kind, text = type(found).__name__, f"{found!r:.60}"
    quoted = text if text.startswith(kind) else f"{kind} {text}"
    return WrongArgument(f"{name}: argument {argument}", expected=expected, found=quoted)


def _name(kind: type) -> str:
    plain = {
        numbers.Real: "a number",
        numbers.Integral: "a whole number",
        str: "a text",
        os.PathLike: "a path",
    }
    return plain.get(kind, kind.__name__)


@functools.cache
def _kinds(function: Any, owner: type | None) -> dict[str, tuple[type, ...]]:
    """Classes of the arguments that can be compared, by their names."""
    # Fields that a dataclass inherits are annotated in the module of its base.
    made = owner is not None and is_dataclass(owner)
    hints = get_type_hints(owner) if made else inspect.get_annotations(function, eval_str=True)
    return {name: kinds for name, hint in hints.items() if name != "return" and (kinds := _classes(hint))}


def _classes(hint: object) -> tuple[type, ...]:
    """Classes that an annotation allows; none where it cannot be compared."""
    if get_origin(hint) in (Union, types.UnionType):
        parts = [_classes(part) for part in get_args(hint)]
        return sum(parts, ()) if all(parts) else ()
    if hint is None:
        return (type(None),)
    if (origin := get_origin(hint)) is not None and origin is not os.PathLike:
        return _classes(origin) if isinstance(origin, type) and hasattr(origin, "__orig_bases__") else ()
    plain = WIDER.get(origin or hint)
    if plain:
        return plain
    if hint is type(None):
        return (type(None),)
    own = isinstance(hint, type) and hint.__module__.partition(".")[0] == "yarnscale"
    # Only protocols that say so can be compared.
    known = getattr(hint, "_is_runtime_protocol", not getattr(hint, "_is_protocol", False))
    return (hint,) if own and known else ()  # type: ignore[return-value]
