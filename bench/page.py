"""The page of a log in headless Chromium: size, from opening to drawn, a zoom, a cursor's step.

    python bench/page.py [LOG.mcap] [--old PAGE.html] [--times 7] [--keep]

``--old``: a page of the same log as an earlier version made it with plotly; both are measured in one run, in
turns.
One process of the browser a page and turn; times are its own, from the frame that shows the last of it.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import tempfile
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from results import keep

import faultloop
from faultloop.review.page import write_html
from faultloop.review.summary import summarize

ROOT = Path(__file__).resolve().parents[1]
OUTER = Path(__file__).with_name("page_outer.html").read_text(encoding="utf-8")


class Told(SimpleHTTPRequestHandler):
    """Serves a folder, and takes what the page measured."""

    def __init__(self, *arguments: Any, heard: list[dict], came: threading.Event, **more: Any) -> None:
        self.heard, self.came = heard, came
        super().__init__(*arguments, **more)

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.heard.append(json.loads(body))
        self.send_response(204)
        self.end_headers()
        self.came.set()

    def log_message(self, *_: Any) -> None:
        pass


def measured(folder: Path, page: Path) -> dict[str, Any]:
    """One opening of a page in ``folder``."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    assert chromium is not None, "needs Chromium: apt-get install chromium"
    heard: list[dict] = []
    came = threading.Event()
    (folder / "outer.html").write_text(OUTER.replace("PAGE", page.name), encoding="utf-8")
    handler = partial(Told, directory=str(folder), heard=heard, came=came)
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server, tempfile.TemporaryDirectory() as profile:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        command = [
            chromium, "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
            "--no-first-run", f"--user-data-dir={profile}", "--window-size=1280,1000",
            f"http://127.0.0.1:{server.server_address[1]}/outer.html",
        ]  # fmt: skip
        browser = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            assert came.wait(120), f"{page.name} was not drawn within two minutes"
        finally:
            browser.terminate()
            browser.wait()
            server.shutdown()
    return heard[0]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("log", nargs="?", type=Path)
    parser.add_argument("--old", type=Path)
    parser.add_argument("--times", type=int, default=7)
    parser.add_argument("--keep", action="store_true", help="leave the figures for docs/evidence.py")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if given.log is None:
            given.log = folder / "ag-zone1.mcap"
            faultloop.run(ROOT / "scenarios" / "ag-zone1.toml", log=given.log)
        log = faultloop.open_log(given.log)
        pages = {"ours": write_html(log, summarize(log), folder / "ours.html")}
        if given.old is not None:
            pages["old"] = Path(shutil.copy(given.old, folder / "old.html"))
        found: dict[str, list[dict]] = {kind: [] for kind in pages}
        for _ in range(given.times):
            for kind, page in pages.items():
                found[kind].append(measured(folder, page))
        load = f"at a load of {os.getloadavg()[0]:.0f} on {os.cpu_count()} cores"
        openings = f"{given.times} openings, {load}, median (greatest)"
        title = f"Page of `{given.log.stem}` in Chromium, 1280 px: size, time to open, zoom, cursor"
        print(f"{title}: {openings}")
        told = {kind: told_of(page, found[kind]) for kind, page in pages.items()}
        for kind, text in told.items():
            print(f"{kind}: {text}")
        if given.keep:
            keep(
                "A run explains itself",
                [(title, "; ".join([openings, *(f"{kind}: {text}" for kind, text in told.items())]))],
            )


def told_of(page: Path, openings: list[dict[str, Any]]) -> str:
    """Size and times of a page."""
    parts = [f"{page.stat().st_size / 1e6:.2f} MB"]
    for what, name in (("open", "opened and drawn"), ("zoom", "zoom"), ("cursor", "cursor")):
        values = [v for one in openings for v in (one[what] if what != "open" else [one[what]])]
        parts.append(f"{name} {statistics.median(values):.0f} ({max(values):.0f}) ms")
    return ", ".join(parts)


if __name__ == "__main__":
    main()
