"""The same parts on a dask.distributed cluster; only this process writes files."""

from __future__ import annotations

import copy
import logging
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, cast

from faultloop.errors import InputError
from faultloop.study.campaign.parts import Parts

CONNECT_S = 10


def by_cluster(job: Any, todo: list[int], address: str, parts: Parts) -> Iterator[int]:
    """Parts as they are finished.

    Raises
    ------
    InputError : no cluster there, none of its workers left, or dask is not installed.
    """
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise InputError("needs dask: pip install 'faultloop[cluster]'", key="--scheduler") from None
    try:
        _knock(address)
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        why = " ".join(str(error).split())[:120]
        raise InputError(f"no cluster at '{address}' ({why})", key="--scheduler") from None
    with _quiet(), client:
        ready = as_completed(loop=client.loop)
        waiting = iter(todo)
        shared = client.scatter(job, broadcast=True)

        def hand_out() -> bool:
            number = next(waiting, None)
            if number is None:
                return False
            ready.add(client.submit(_made, shared, number, pure=False, retries=2))
            return True

        cores = cast("dict[str, int]", client.ncores())  # a coroutine for an asynchronous client alone
        for _ in range(2 * max(sum(cores.values()), 1)):
            if not hand_out():
                break
        for future in ready:
            try:
                number, rows, waves = future.result()
            except InputError:
                raise
            except Exception as error:  # a worker that died too often, whatever else the cluster says
                raise InputError(
                    f"the cluster gave up a part ({type(error).__name__}); {parts.kept()}; the same command"
                    " goes on from there",
                    file=parts.out,
                ) from None
            job.files.write(number, rows, waves)
            future.release()
            yield number
            hand_out()


def _knock(address: str) -> None:
    """OSError where nobody is there, ValueError for no address: a `Client` that finds nobody is never closed,
    and says so with a traceback, 20 s after the process's last word."""
    from distributed.comm.addressing import get_address_host_port

    scheme, colon, _ = address.partition("://")
    if scheme in ("tcp", "tls") or not colon:
        socket.create_connection(get_address_host_port(address, strict=True), CONNECT_S).close()


@contextmanager
def _quiet() -> Iterator[None]:
    """Without dask's own word (and traceback) on a cluster that went away: the error is told in one line."""
    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] == "distributed"]
    before = {name: logging.getLogger(name).level for name in names}  # dask gives some a level of their own
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for name, level in before.items():
            logging.getLogger(name).setLevel(level)


def _made(job: Any, number: int) -> tuple[int, Any, Any]:
    """On a worker, whose threads share the job but not its relays."""
    return number, *copy.copy(job).made(number)
