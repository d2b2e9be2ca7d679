"""What typer's shell completion lacks."""

from __future__ import annotations

from typer import _completion_shared

FIRST_TAB = """
if [[ "$funcstack[1]" == "_%(prog_name)s" ]]; then %(complete_func)s; fi
"""


def complete_at_the_first_tab() -> None:
    """zsh reads the file that ``--install-completion`` writes at the first Tab, and takes it for the function
    that completes: typer's only defines one, and that Tab does nothing."""
    scripts: dict[str, str] = getattr(_completion_shared, "_completion_scripts", {})
    if FIRST_TAB not in scripts.get("zsh", FIRST_TAB):
        scripts["zsh"] += FIRST_TAB
