"""Processes that solves run in."""

from __future__ import annotations

import os
import signal

import pytest

from yarnscale.homogenize.executors import kept_workers, local_workers


def test_kept_processes_serve_again_until_they_die() -> None:
    def process() -> int:
        with local_workers(1) as pool:
            return pool.submit(os.getpid).result()

    with kept_workers():
        first = process()
        assert process() == first
        with kept_workers():
            assert process() == first
        assert process() == first
        os.kill(first, signal.SIGKILL)
        second = process()
        assert second != first
    with pytest.raises(ProcessLookupError):
        os.kill(second, 0)
