"""A picture of a log in rerun, without a screen.

    python bench/rerun_view.py [LOG.mcap | SCENARIO.toml] [OUT.png] [TIME_MS]

TIME_MS counts from the fault; of a log without one it is left out.

Needs a Vulkan driver; Mesa's software one will do (Debian: mesa-vulkan-drivers).  Prints what the viewer
could not show, which should be nothing.  It runs with a configuration of its own, its analytics off.
"""

from __future__ import annotations

import importlib
import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import rerun_cli
from rerun.experimental import ViewerClient

from faultloop.io.mcap_reader import open_log
from faultloop.review.rerun import show
from faultloop.review.summary import summarize

ROOT = Path(__file__).resolve().parents[1]
PROGRAM = Path(rerun_cli.__file__).with_name("rerun.exe" if sys.platform == "win32" else "rerun")


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def screenshot(rrd: Path, png: Path, t_ms: float | None) -> list[str]:
    """Opens a recording in a headless viewer and saves what it shows; returns the viewer's complaints."""
    with ViewerClient.spawn(headless=True, port=free_port(), executable_path=str(PROGRAM)) as viewer:
        viewer.open(str(rrd))
        time.sleep(3.0)  # views come to rest; open() answers when the data is there
        if t_ms is not None:
            viewer.set_time("from fault", duration=t_ms / 1e3, play_state="paused")
            time.sleep(2.0)
        viewer.save_screenshot(str(png))
        return [f"{view.name}: {report}" for view in viewer.get_state().views for report in view.reports]


def main() -> None:
    given = [*sys.argv[1:], "", "", ""]
    source = Path(given[0] or ROOT / "scenarios" / "ag-zone1.toml")
    png = Path(given[1] or "rerun_view.png").absolute()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CONFIG_HOME"] = folder
        subprocess.run([PROGRAM, "analytics", "disable"], check=True, capture_output=True)
        if source.suffix == ".toml":
            import faultloop

            faultloop.run(source, log=Path(folder, "run.mcap"))
            source = Path(folder, "run.mcap")
        rrd = Path(folder, "run.rrd")
        importlib.import_module("rerun")  # which is not what is measured
        begin = time.perf_counter()
        log = open_log(source)
        show(log, summarize(log), str(rrd))
        rows = sum(len(log.samples(relay)) for relay in log.relays)
        print(f"to rerun: {1e6 * (time.perf_counter() - begin) / max(rows, 1):.1f} us per sample of a relay")
        for line in screenshot(rrd, png, float(given[2]) if given[2] else None):
            print(line)
    print(png)


if __name__ == "__main__":
    main()
