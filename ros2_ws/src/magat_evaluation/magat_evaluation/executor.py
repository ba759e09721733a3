# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Where work is done besides this process: in processes of this machine, or on a Dask cluster."""

import os
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context

from magat_node.errors import MagatError

#: A number of processes, or the address of a Dask cluster's scheduler, such as tcp://10.0.0.1:8786.
Workers = int | str
#: Seconds that a scheduler and its first worker have to answer.
PATIENCE = 10.0


@contextmanager
def executor(workers: Workers) -> Iterator[Executor]:
    """An executor on ``workers``; its `map` yields results in the order of the items.

    Each worker of this machine computes in one thread. Work that has not begun when the ``with`` statement ends is
    dropped. Dask gives the work of a lost worker to another one.

    Raises:
        MagatError: the cluster does not answer, or has no worker; or work was lost with the workers that did it.
    """
    if isinstance(workers, str):
        with _cluster(workers) as found:
            yield found
        return
    # Spawned, because the libraries' threads do not survive a fork.
    pool = ProcessPoolExecutor(workers, get_context("spawn"), os.putenv, ("OMP_NUM_THREADS", "1"))
    try:
        yield pool
    except BrokenProcessPool as error:
        raise MagatError(f"one of {workers} processes was killed: if memory was short, use fewer") from error
    finally:
        pool.shutdown(cancel_futures=True)  # the work that has begun is finished


@contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    try:
        from distributed import Client, KilledWorker
    except ImportError as error:
        raise MagatError("a cluster needs Dask: pip install -r requirements-train.txt") from error
    try:
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise MagatError(
            f"no Dask scheduler answers at {address}: give an address such as tcp://10.0.0.1:8786, and start one with "
            "`dask scheduler`"
        ) from error
    try:
        try:
            client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError as error:
            raise MagatError(
                f"the Dask cluster at {address} has no worker: start some with `dask worker {address}`"
            ) from error
        # Not pure: two runs of the same work are two results, and nothing has to be hashed to find that out.
        yield client.get_executor(pure=False)
    except KilledWorker as error:
        raise MagatError(f"workers of {address} ended again and again during the same work: {error}") from error
    except CancelledError as error:
        raise MagatError(f"the Dask scheduler at {address} is gone: start it, and run the command again") from error
    finally:
        client.close()
