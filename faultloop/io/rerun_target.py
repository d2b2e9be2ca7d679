"""Where a rerun stream goes: a viewer that is started, a server, a file, or a viewer that is there."""

from __future__ import annotations

import importlib
import socket
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from faultloop.errors import InputError
from faultloop.io.output_file import open_part

GRPC_PORT = 9876


class Opened(NamedTuple):
    """What a stream was connected to: a server's address; a file, and the name it has while it is written."""

    url: str | None
    file: Path | None
    part: Path | None


def open_target(rr: Any, stream: Any, target: str) -> Opened:
    """Connect a recording stream to ``spawn``, ``serve``, a file ``F.rrd`` or a viewer's URL.

    Raises InputError for a target that is none of these or is not there.
    """
    if target == "spawn":
        _spawn()
        _connect(stream, rr.GrpcSink(_own_url()), "no viewer")
    elif target == "serve":
        sink = rr.GrpcServerSink(bind_ip="127.0.0.1", port=GRPC_PORT, server_memory_limit="2GiB")
        _connect(stream, sink, f"port {GRPC_PORT} is in use; is another viewer or server running?")
        return Opened(_own_url(), None, None)
    elif target.endswith(".rrd"):
        file = Path(target)
        part, aside = open_part(file)
        aside.close()
        _connect(stream, rr.FileSink(str(part)), "cannot be written")
        return Opened(None, file, part)
    elif target.startswith(("rerun://", "rerun+http://", "rerun+https://")):
        _knock(target)
        _connect(stream, rr.GrpcSink(target), f"{target} is no address of a rerun viewer")
    else:
        raise InputError(
            f"{target!r} is no rerun target; known: spawn, serve, FILE.rrd, rerun+http://HOST:PORT/proxy",
            key="--rerun",
        )
    return Opened(None, None, None)


def _own_url() -> str:
    return f"rerun+http://127.0.0.1:{GRPC_PORT}/proxy"


def _connect(stream: Any, sink: Any, says: str) -> None:
    try:
        stream.set_sinks(sink)
    except (ValueError, RuntimeError, OSError) as error:
        raise InputError(f"rerun: {says}", key="--rerun") from error


def _knock(target: str) -> None:
    """A connection to no viewer would not fail, it would wait for ever."""
    where = urlsplit(target.replace("rerun+", "").replace("rerun://", "https://"))
    port = where.port or (443 if where.scheme == "https" else 80)
    try:
        socket.create_connection((where.hostname or "", port), timeout=3).close()
    except OSError as error:
        raise InputError(f"no viewer answers at {target}: start one with `rerun`", key="--rerun") from error


def _spawn() -> None:
    """Start the package's own program: the one on PATH may be another version, or not there."""
    experimental = importlib.import_module("rerun.experimental")
    command = Path(importlib.import_module("rerun_cli").__file__ or "")
    program = next((p for p in command.parent.glob("rerun*") if p.suffix in ("", ".exe")), None)
    try:
        experimental.ViewerClient.spawn(executable_path=str(program) if program else None, port=GRPC_PORT)
    except (RuntimeError, OSError) as error:
        raise InputError(
            f"rerun's viewer does not start ({error}); is there a display?", key="--rerun"
        ) from error
