"""Processes that work on a study: none outlives it, and one that dies ends it in one line."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from typing import Any

from faultloop.errors import InputError


def begin_worker() -> None:
    """In a new worker: it ends with its parent, whatever ends that, and leaves Ctrl-C to it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=lambda: (parent.join(), os._exit(1)), daemon=True).start()


@contextmanager
def pool_of(
    workers: int, kept: Callable[[], InputError], begin: Callable[..., None] = begin_worker, *shared: Any
) -> Iterator[ProcessPoolExecutor]:
    """A pool of ``workers`` that each began with ``begin(*shared)``.

    Raises
    ------
    InputError : a worker died (killed, or out of memory): what ``kept()`` then says.
    """
    pool = ProcessPoolExecutor(workers, get_context("spawn"), begin, shared)
    try:
        yield pool
        pool.shutdown()
    except BaseException as error:
        # All of them: one that was begun while the pool noticed that another had died, it would wait for.
        for process in list((pool._processes or {}).values()):
            process.terminate()
        if isinstance(error, BrokenProcessPool):
            raise kept() from None
        raise
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
