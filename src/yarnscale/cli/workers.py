"""Processes and clusters that commands are given."""

from __future__ import annotations

import argparse
import os

from yarnscale.cli.console import print_notice
from yarnscale.homogenize.executors import reach_workers


def worker_count(options: argparse.Namespace) -> int:
    """Processes to use: ``--workers``, else one per core that this process may use."""
    if options.workers is not None:
        return options.workers
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def reach_dask(options: argparse.Namespace) -> None:
    """Wait for the workers of ``--dask``, if it is given; InputError where they cannot be reached."""
    if options.dask is not None:
        reach_workers(options.dask, on_notice=print_notice)
