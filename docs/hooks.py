"""What the site's build makes by itself: the gallery, the Python reference, equations as MathML.

mkdocs calls the functions by their names.  Nothing is written into docs/, and no page needs a network.
"""

from __future__ import annotations

import html
import importlib.util
import re
import tempfile
import tomllib
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parent.parent
SHOWN = ("ag-zone1", "weak-source", "zone2-remote-end", "evolving-fault", "parallel-lines", "reclosing")
"""Scenarios of the gallery; the first one's page, too."""
IMPORTED = {
    "testobject.rio": "--z1 2.079,9.781",
    "abb.xrio": "--z1 4.158,19.563 --z0 14.138,66.514 --frequency 50",
}
"""Settings files of the tests, and what must be given beside each."""
EQUATION = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)


def on_files(files: Any, config: Any) -> Any:
    """The pages and pictures that are made, beside those that lie there."""
    for name, content in (*_gallery(), ("api.md", _api())):
        files.append(File.generated(config, name, content=content))
    return files


def on_page_content(content: str, **_: Any) -> str:
    """Equations as MathML, which browsers draw by themselves."""

    def equation(found: re.Match[str]) -> str:
        if found[2] == "(":
            return convert(html.unescape(found[3]), display="inline")
        made = convert(html.unescape(found[3]), display="block")
        return f'<div style="overflow-x:auto;overflow-y:hidden">{made}</div>'  # and not the page

    return EQUATION.sub(equation, content)


def _gallery() -> list[tuple[str, bytes | str]]:
    """The shipped scenarios, run: a picture of each, with what its file says of itself."""
    import faultloop
    from faultloop.review.page import write_html
    from faultloop.review.plot import write_png
    from faultloop.review.summary import summarize

    made: list[tuple[str, bytes | str]] = []
    lines = ["# Gallery", "", "Made by the build of this site, from the shipped scenarios as they are.", ""]
    with tempfile.TemporaryDirectory() as folder:
        for name in SHOWN:
            path = ROOT / "scenarios" / f"{name}.toml"
            target = Path(folder) / name
            faultloop.run(path, log=target.with_suffix(".mcap"))
            log = faultloop.open_log(target.with_suffix(".mcap"))
            summary = summarize(log)
            write_png(log, summary, target.with_suffix(".png"))
            made.append((f"gallery/{name}.png", target.with_suffix(".png").read_bytes()))
            text = path.read_text(encoding="utf-8")
            lines += [f"## {tomllib.loads(text)['scenario']['name']}", "", _said(text), ""]
            lines += [f"    faultloop run scenarios/{name}.toml", ""]
            if name == SHOWN[0]:
                write_html(log, summary, target.with_suffix(".html"))
                made.append((f"gallery/{name}.html", target.with_suffix(".html").read_bytes()))
                lines += [f"[Its page](gallery/{name}.html), as `review --html` makes it.", ""]
            lines += [f"![{name}](gallery/{name}.png)", ""]
        lines += ["## Settings of other tools", "", "The same zones, from files of two formats.", ""]
        for name, given in IMPORTED.items():
            target = Path(folder) / f"{name}.png"
            _imported(ROOT / "tests" / "interchange" / "line-7" / name, given, target)
            made.append((f"gallery/{target.name}", target.read_bytes()))
            lines += [f"    faultloop import {name} {given} --png zones.png", ""]
            lines += [f"![{name}](gallery/{target.name})", ""]
    return [*made, ("gallery.md", "\n".join(lines))]


def _imported(path: Path, given: str, target: Path) -> None:
    """The picture that ``faultloop import`` makes."""
    import contextlib
    import io

    from faultloop.cli import call

    with contextlib.redirect_stdout(io.StringIO()):
        assert call(["import", str(path), *given.split(), "--png", str(target)]) == 0


def _said(text: str) -> str:
    """The second paragraph of a scenario's comment, which tells what it is about."""
    comment = "\n".join(line[1:].strip() for line in text.split("\n[", 1)[0].splitlines() if line[:1] == "#")
    return comment.split("\n\n")[1]


def _api() -> str:
    """A heading for each folder, and an entry for each public name of docs/reference.py, in full."""
    place = importlib.util.spec_from_file_location("reference", ROOT / "docs" / "reference.py")
    assert place is not None and place.loader is not None
    reference = importlib.util.module_from_spec(place)
    place.loader.exec_module(reference)
    lines = [
        "# Python",
        "",
        "From the docstrings. Conventions of time, units and order: [Interfaces](interfaces.md).",
        "",
    ]
    for title, modules in reference.MODULES.items():
        lines += [f"## {title}", ""]
        for module, names in modules.items():
            lines += [f"::: {module}.{name}\n" for name in names.split()]
    return "\n".join(lines)
