"""The page in headless Chromium: it draws, its cursors tell the log's numbers, nothing overlaps."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from faultloop.io.mcap_reader import open_log
from faultloop.review.characteristic import characteristic
from faultloop.review.page import write_html
from faultloop.review.retrace import retrace
from faultloop.review.rows import relay_rows
from faultloop.review.summary import summarize
from tests.review.review_logs import FAULT_NS, write_log
from tests.review.why_cases import QUAD, fault, write

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium: apt-get install chromium"),
    pytest.mark.xdist_group("chromium"),
]

MEASURE = """
<body style="margin:0">
<iframe id="f" src="{page}" width="{width}" height="3000" style="border:0"></iframe>
<script>
const box = (e) => e.getBoundingClientRect(), out = {{ over: [] }};
const meet = (a, b) => Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1
  && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 1;
function measure() {{
  const d = f.contentDocument, w = f.contentWindow, root = d.documentElement;
  const stands = (e) => box(e).width && box(e).height && w.getComputedStyle(e).position !== "absolute";
  for (const parent of d.querySelectorAll("body, .relay, .side, .caption, #bar, .plots, .group")) {{
    const all = [...parent.children].filter(stands);
    all.forEach((one, i) => all.slice(i + 1).forEach((other) => {{
      if (meet(box(one), box(other))) out.over.push([one, other].map((e) => e.className + e.id).join(" / "));
    }}));
  }}
  const parts = [...d.querySelectorAll("button, canvas, select, p, h1, h2, h3")];
  out.outside = parts.filter((e) => box(e).right > {width} + 1).map((e) => e.outerHTML.slice(0, 80));
  out.ready = root.dataset.ready;
  out.wider = root.scrollWidth - root.clientWidth;
  out.canvases = d.querySelectorAll("canvas").length;
  const told = document.createElement("pre");
  told.id = "out";
  told.textContent = JSON.stringify(out);
  document.body.append(told);
}}
f.onload = () => setTimeout(measure, 400);
</script></body>
"""


def browser(url: str, *arguments: str) -> tuple[str, str]:
    """What it prints of the page, and of its console."""
    assert CHROMIUM is not None
    command = [
        CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
        "--allow-file-access-from-files", "--enable-logging=stderr", "--virtual-time-budget=6000",
        *arguments, url,
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    return done.stdout, "\n".join(line for line in done.stderr.splitlines() if "CONSOLE" in line)


DRAWN = """
<body><iframe id="f" src="{page}" width="1280" height="900"></iframe>
<script>
f.onload = () => setTimeout(() => {{
  const w = f.contentWindow, relay = w.page.relays[0], told = document.createElement("pre");
  const loops = (row, zone) => [0, 1, 2, 3, 4, 5].map((loop) => w.characteristic(relay, row, zone, loop));
  const of = (row) => Object.values(relay.dynamic.zones).map((zone) => loops(row, zone));
  told.id = "out";
  told.textContent = JSON.stringify({rows}.map(of));
  document.body.append(told);
}}, 400);
</script></body>
"""


def test_characteristics_are_drawn_as_the_relay_had_them(tmp_path: Path) -> None:
    """The page's script against NumPy: a memory-polarized mho, one polarized across, a quadrilateral with its
    line tilted by the load; at rest there is none."""
    zones = [{"zone": 1, "reach_pu": 0.8}, {"zone": 2, "reach_pu": 1.3, "polarization": "cross"}, *QUAD]
    log = open_log(write(tmp_path / "a.mcap", {"pdis": zones}, fault("BC", 0.75, resistance=2.0), "BC"))
    write_html(log, summarize(log), tmp_path / "a.html")
    known, own = retrace(log, "R1"), relay_rows(log, "R1")
    rows = [100, *np.searchsorted(own.t_ns, known.t_ns[known.shared["fault"] == 5][[20, 300]]).tolist()]
    outer = tmp_path / "outer.html"
    outer.write_text(DRAWN.format(page="a.html", rows=rows), encoding="utf-8")
    seen, console = browser(f"file://{outer}", "--dump-dom")
    found = re.search(r'<pre id="out">(.*?)</pre>', seen, re.S)
    assert found is not None and console == ""
    drawn = json.loads(html.unescape(found[1]))
    assert drawn[0] == [[None] * 6] * 3
    for row, told in zip(rows[1:], drawn[1:], strict=True):
        q = known.shared[np.searchsorted(known.t_ns, own.t_ns[row])]
        for zone in range(3):
            c = known.constants["pdis"][zone]
            points = characteristic(known.constants["shared"], c, q, own.phasors[row], 4)
            found_there = np.array(told[zone][4]) @ [1, 1j]
            np.testing.assert_allclose(found_there, points, atol=1e-3 * np.abs(points).max())


NAMES = """
<body><iframe id="f" src="{page}" width="1280" height="900"></iframe>
<script>
f.onload = () => setTimeout(() => {{
  const w = f.contentWindow, told = document.createElement("pre"), out = [];
  const size = [330, 240], middle = [165, 120];
  for (let n = 0; n < 24; n++) {{
    const arrows = [5, 4, 3, 2, 1, 0].map((k) => {{
      const angle = -2.0944 * (k % 3) - (k < 3 ? 0 : n * 0.2618), length = k < 3 ? 90 : [98, 14, 11][k - 3];
      return {{ k, angle, length, x: 165 + length * Math.cos(angle), y: 120 - length * Math.sin(angle) }};
    }});
    out.push([w.eval("namePlaces")(arrows, arrows, middle, size), arrows.map((a) => [a.x, a.y])]);
  }}
  told.id = "out"; told.textContent = JSON.stringify(out);
  document.body.append(told);
}}, 400);
</script></body>
"""


def test_names_of_phasors_are_clear_of_arrows_and_names(page: Path) -> None:
    """Two small currents beside three voltages and a great one, turned in 24 steps against the voltages."""
    outer = page.with_name("names.html")
    outer.write_text(NAMES.format(page=page.name), encoding="utf-8")
    seen, console = browser(f"file://{outer}", "--dump-dom")
    found = re.search(r'<pre id="out">(.*?)</pre>', seen, re.S)
    assert found is not None and console == ""
    for names, tips in json.loads(html.unescape(found[1])):
        assert len(names) == 6
        for n, name in enumerate(names):
            assert 0 < name[0] < 330 and 0 < name[1] < 240
            for other in names[:n]:
                assert abs(name[0] - other[0]) >= 18 or abs(name[1] - other[1]) >= 12
            for tip in tips:  # half a name is 8 by 5 pixels
                way = np.array([165, 120]) + np.linspace(0, 1, 200)[:, None] * (np.array(tip) - [165, 120])
                assert not (np.abs(way - name) < [8, 5]).all(axis=1).any()


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("browser")
    log = open_log(write_log(folder / "known.mcap"))
    return write_html(log, summarize(log), folder / "known.html")


def test_cursors_tell_the_numbers_of_the_log(page: Path) -> None:
    """At A and B: samples, phasor, sequence components, impedance; and nothing is wrong on the console."""
    seen, console = browser(f"file://{page}#a=20.0&b=-15.0", "--dump-dom")
    assert console == "" and 'data-ready="1"' in seen
    own = relay_rows(open_log(page.with_suffix(".mcap")), "R1")
    ms = (own.t_ns - FAULT_NS) / 1e6
    a, b = np.abs(ms - 20.0).argmin(), np.abs(ms + 15.0).argmin()
    times = re.search(r'<span id="times">(.*?)</div>', seen, re.S)
    assert times is not None
    told = re.findall(r"(-?\d+\.\d{3}) ms", times[1])
    assert told == [f"{ms[a]:.3f}", f"{ms[b]:.3f}", f"{ms[a] - ms[b]:.3f}"]
    body = re.search(r'<table class="values">(.*?)</table>', seen, re.S)
    assert body is not None
    cells = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in re.findall(r"<tr>(.*?)</tr>", body[1])]
    table = {row[0]: row[1:] for row in cells if row}
    assert float(table["VA"][0]) == pytest.approx(own.samples[a, 0] / 1e3, rel=2e-3, abs=0.01)
    assert float(table["IA"][1]) == pytest.approx(own.samples[b, 3] / 1e3, rel=2e-3, abs=0.001)
    assert float(table["VA"][3]) == pytest.approx(80.0, rel=1e-3)
    assert float(table["VA"][4].rstrip("°")) == pytest.approx(28.0 - 30.0, abs=0.1)
    turn = np.exp(2j * np.pi / 3)
    i2 = (own.phasors[a, 3] + turn**2 * own.phasors[a, 4] + turn * own.phasors[a, 5]) / 3
    assert float(table["I2"][3]) == pytest.approx(abs(i2) / 1e3, rel=1e-3)
    assert "3.500 + j 16.00 Ω" in html.unescape(seen)


@pytest.mark.parametrize(
    "width", [1280, 390, *(pytest.param(width, marks=pytest.mark.slow) for width in (2560, 768, 500))]
)
def test_nothing_overlaps_or_is_cut(page: Path, width: int) -> None:
    outer = page.with_name(f"outer{width}.html")
    outer.write_text(MEASURE.format(page=page.name + "#a=20&b=-15", width=width), encoding="utf-8")
    seen, console = browser(f"file://{outer}", "--dump-dom", f"--window-size={max(width, 600)},3000")
    found = re.search(r'<pre id="out">(.*?)</pre>', seen, re.S)
    assert found is not None and console == ""
    told = json.loads(html.unescape(found[1]))
    assert told["ready"] == "1" and told["canvases"] == 5
    assert (told["over"], told["outside"]) == ([], [])
    assert told["wider"] <= 0


def test_light_and_dark_differ(page: Path) -> None:
    shades = []
    for theme in ("light", "dark"):
        picture = page.with_name(f"{theme}.png")
        browser(f"file://{page}#theme={theme}", f"--screenshot={picture}", "--window-size=1280,700")
        pixels = imread(picture)[..., :3]
        shades.append(float(np.median(pixels)))
        assert len(np.unique(np.round(pixels[::2, ::2].reshape(-1, 3), 2), axis=0)) > 50  # something is drawn
    assert shades[0] > 0.9 and shades[1] < 0.2
