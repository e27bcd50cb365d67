"""One BLAS thread for work on small arrays.

Matrices of a cell are small and called for thousands of times: threads of a BLAS library make that many times slower,
the more so where several processes share the machine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, wraps
from importlib import import_module
from importlib.util import find_spec
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

_P = ParamSpec("_P")
_R = TypeVar("_R")


@cache
def _controller() -> ThreadpoolController:
    # A controller knows the libraries that are loaded when it is made: load those that we use first.
    for name in ("scipy.linalg", "cvxopt"):
        if find_spec(name.partition(".")[0]) is not None:
            import_module(name)
    return ThreadpoolController()


@contextmanager
def one_thread() -> Iterator[None]:
    """Within the block, BLAS runs on one thread; the former number comes back after it."""
    with _controller().limit(limits=1, user_api="blas"):
        yield


def on_one_thread(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Decorate a function to run within ``one_thread``."""

    @wraps(function)
    def limited(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        with one_thread():
            return function(*args, **kwargs)

    return limited
