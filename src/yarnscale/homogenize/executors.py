"""Where solves run: processes on this machine, or the workers of a Dask cluster."""

from __future__ import annotations

import logging
import os
import time
import traceback
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from multiprocessing import get_context
from typing import TYPE_CHECKING, Any

from yarnscale.errors import InputError
from yarnscale.homogenize.worker import prepare

if TYPE_CHECKING:
    from distributed import Client

RETRIES = 3
"""How often Dask tries a state again whose worker died."""
PATIENCE = 60.0
"""How long a run waits for a cluster's first worker, or for the next one when all are gone [s]."""
CONNECT = 10.0
"""How long a scheduler has to answer [s]."""
_THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "YARNSCALE_THREADS",
)


_KEPT: ContextVar[dict[int, ProcessPoolExecutor] | None] = ContextVar("kept", default=None)


def _pool(count: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(count, mp_context=get_context("spawn"), initializer=prepare)


def _living(pools: dict[int, ProcessPoolExecutor], count: int) -> ProcessPoolExecutor:
    """The pool of so many processes, a new one where there is none or its processes died."""
    if count in pools:
        with suppress(BrokenProcessPool):
            pools[count].submit(int).result()
            return pools[count]
    pools[count] = _pool(count)
    return pools[count]


@contextmanager
def _ending(pools: Collection[ProcessPoolExecutor]) -> Iterator[Collection[ProcessPoolExecutor]]:
    """Shut pools down in the end, without waiting for what is left to do where the block fails."""
    try:
        yield pools
    except BaseException:
        for pool in pools:
            pool.shutdown(wait=False, cancel_futures=True)
        raise
    for pool in pools:
        pool.shutdown()


@contextmanager
def kept_workers() -> Iterator[None]:
    """Within, processes of ``local_workers`` serve one use of it after the other: each takes seconds to start.

    Within another such block, its processes serve.
    """
    if _KEPT.get() is not None:
        yield
        return
    pools: dict[int, ProcessPoolExecutor] = {}
    token = _KEPT.set(pools)
    try:
        with _ending(pools.values()):
            yield
    finally:
        _KEPT.reset(token)


@contextmanager
def local_workers(count: int) -> Iterator[Executor]:
    """Processes on this machine, spawned (never forked), one numerical thread each."""
    kept = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        kept_pools = _KEPT.get()
        if kept_pools is not None:
            yield _living(kept_pools, count)
        else:
            with _ending([_pool(count)]) as (pool,):
                yield pool
    finally:
        for name, value in kept.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


class DaskExecutor(Executor):
    """The workers of a cluster as an executor that notices when nobody works any more."""

    def __init__(self, client: Client) -> None:
        self.client = client
        self._inner = client.get_executor(pure=False, retries=RETRIES)
        self._seen = time.monotonic()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future:
        return self._inner.submit(fn, *args, **kwargs)

    @property
    def workers(self) -> int:
        return len(self.client.scheduler_info()["workers"])

    def look(self) -> None:
        """ChildProcessError where the cluster has had no worker for ``PATIENCE`` seconds.

        If the scheduler is lost, running solves end as lost ones, which is handled elsewhere.
        """
        try:
            workers = self.client.scheduler_info()["workers"] if self.client.status == "running" else None
        except (OSError, ValueError, CancelledError):
            return
        if workers != {}:
            self._seen = time.monotonic()
        elif time.monotonic() - self._seen > PATIENCE:
            raise ChildProcessError(f"no Dask worker for {PATIENCE:g} s; what was finished is kept")


@contextmanager
def dask_workers(address: str, *, on_notice: Callable[[str], None] | None = None) -> Iterator[DaskExecutor]:
    """Workers of a Dask cluster at a scheduler address.

    ``on_notice`` gets a sentence while the cluster has no workers. InputError where no scheduler answers, or no worker
    appears within ``PATIENCE`` seconds.
    """
    try:
        from distributed import Client
    except ImportError:
        raise InputError("Dask is not installed", expected="the extra 'dask'", found="no module distributed") from None
    # Its messages of a lost connection, with tracebacks, are replaced by one line.
    with _silent("distributed"), _client(Client, address) as client:
        _await_workers(client, address, on_notice)
        yield DaskExecutor(client)


@contextmanager
def _client(kind: type[Client], address: str) -> Iterator[Client]:
    try:
        client = kind(address, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError("no Dask scheduler", where=address, expected="host:port of a scheduler", found=error) from None
    try:
        yield client
    finally:
        client.close(timeout=2)


def _await_workers(client: Client, address: str, on_notice: Callable[[str], None] | None) -> None:
    if client.scheduler_info()["workers"]:
        return
    if on_notice is not None:
        on_notice(f"{address}: no workers yet; waiting {PATIENCE:g} s for the first")
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError:
        raise InputError(
            "no workers at the Dask scheduler", where=address, expected=f"one within {PATIENCE:g} s", found=0
        ) from None
    except OSError:
        raise ChildProcessError("lost the Dask scheduler") from None


@contextmanager
def _silent(name: str) -> Iterator[None]:
    """Hold back what the loggers of a package say; they have levels of their own."""
    kept = {key: logging.getLogger(key).level for key in logging.root.manager.loggerDict if key.startswith(name)}
    for key in kept:
        logging.getLogger(key).setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for key, level in kept.items():
            logging.getLogger(key).setLevel(level)


def reach_workers(address: str, *, on_notice: Callable[[str], None] | None = None) -> None:
    """InputError where no Dask scheduler answers or it has no workers; to be called before anything is written."""
    with dask_workers(address, on_notice=on_notice):
        pass


def is_loss(error: BaseException) -> bool:
    """Whether a solve failed because its worker, or the connection to it, is gone."""
    if isinstance(error, ValueError) and error.__traceback__ is not None:
        # Futures of Dask that are cancelled while they end have no error of their own but one of distributed's code.
        *_, last = traceback.walk_tb(error.__traceback__)
        return last[0].f_code.co_filename.endswith("cfexecutor.py")
    return isinstance(error, (BrokenProcessPool, CancelledError)) or type(error).__name__ in (
        "KilledWorker",  # of distributed, which need not be there
        "CommClosedError",
        "FutureCancelledError",
    )
