"""One BLAS thread for work on small arrays, and parts of a long loop side by side.

Matrices of a cell are small and called for thousands of times: threads of a BLAS library make that many times slower,
the more so where several processes share the machine. Loops over the elements of a cloth are long and compiled without
the interpreter's lock: plain threads share them.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache, wraps
from importlib import import_module
from itertools import pairwise
from typing import ParamSpec, TypeVar

import numpy as np
from threadpoolctl import ThreadpoolController

_P = ParamSpec("_P")
_R = TypeVar("_R")
_T = TypeVar("_T")


@cache
def _controller() -> ThreadpoolController:
    # A controller knows the libraries that are loaded when it is made: load those that we use first.
    import_module("scipy.linalg")
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


def available_threads() -> int:
    """Number of processors this process may use, or ``YARNSCALE_THREADS`` where that is smaller."""
    affinity = getattr(os, "sched_getaffinity", None)
    processors = len(affinity(0)) if affinity is not None else os.cpu_count() or 1
    wanted = os.environ.get("YARNSCALE_THREADS", "")
    return max(1, min(processors, int(wanted))) if wanted.isdigit() else processors


def equal_ranges(count: int) -> list[tuple[int, int]]:
    """Ranges of equal length that cover 0 … count, one for each thread."""
    return list(pairwise(np.linspace(0, count, available_threads() + 1).astype(int).tolist()))


def run_parts(function: Callable[[_T], _R], parts: list[_T]) -> list[_R]:
    """``function`` of every part, side by side: the first on this thread, the others on those of a pool."""
    if len(parts) == 1:
        return [function(parts[0])]
    waiting = [_pool().submit(function, part) for part in parts[1:]]
    return [function(parts[0]), *(task.result() for task in waiting)]


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max(1, available_threads() - 1), thread_name_prefix="yarnscale")
