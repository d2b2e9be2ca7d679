"""The documentation as a site: built strictly, its pages, and what they ask a network for.

    python bench/site.py

Builds it as `make docs` does, into a temporary folder, and looks in every page for a script, style, font or
picture that is not one of its own files.  Exit status 1 where there is one, or where the build warns.
"""

from __future__ import annotations

import os
import re
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ASKED = re.compile(r"""<(?:script|img|link|iframe|source)\b[^>]*?\b(?:src|href)=["']?(https?:)?//[^"'\s>]+""")
LINKS_ONLY = re.compile(r"""rel=["']?(?:canonical|me|next|prev)\b""")


def main() -> int:
    with tempfile.TemporaryDirectory() as name:
        command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", name]
        own = os.environ | {"NO_MKDOCS_2_WARNING": "1", "PYTHONPATH": str(ROOT)}
        done = subprocess.run(command, cwd=ROOT, env=own, capture_output=True, text=True, check=False)
        if not any(Path(name).iterdir()):
            raise SystemExit(done.stderr.strip() or "nothing was built")  # mkdocs is in the extra `docs`
        warned = [line for line in done.stderr.splitlines() if line.startswith(("WARNING", "ERROR"))]
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        folder = Path(name)
        pages = sorted(folder.rglob("*.html"))
        pictures = [path for path in folder.rglob("*") if path.suffix in (".png", ".svg")]
        found = [
            f"    {page.relative_to(folder)}: {match[0]}"
            for page in pages
            for match in ASKED.finditer(page.read_text(encoding="utf-8"))
            if not LINKS_ONLY.search(match[0])
        ]
    print(*warned, *found, sep="\n")
    print(f"{len(pages)} pages, {len(pictures)} pictures, {usage.ru_utime + usage.ru_stime:.0f} s of CPU;")
    print(f"status {done.returncode}, {len(warned)} warnings, {len(found)} things asked of a network")
    return 1 if done.returncode or warned or found or not pages else 0


if __name__ == "__main__":
    raise SystemExit(main())
