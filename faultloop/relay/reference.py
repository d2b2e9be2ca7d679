"""The reference of all keys of relay settings, from their models: ``python -m faultloop.relay.reference``.

It writes docs/settings.md to standard output; a test holds the file to it.
"""

from __future__ import annotations

import sys

from faultloop.config.key_table import section
from faultloop.relay.functions import FUNCTIONS
from faultloop.relay.functions.function import Function
from faultloop.relay.settings import EstimatorSettings, Header, LineSettings, VtSettings

HEAD = """# Relay settings: every key

Made from the settings' models by `python -m faultloop.relay.reference`, and held to them by a test; what the
functions do is in docs/relay.md. With `ohms = "secondary"` every ohm, ampere and volt is secondary.
"""


def reference() -> str:
    """The whole page, Markdown."""
    parts = [HEAD]
    tables = (("relay", Header), ("estimator", EstimatorSettings), ("line", LineSettings), ("vt", VtSettings))
    for key, model in tables:
        parts.append(section(f"`[{key}]`", model))
    for function in FUNCTIONS:
        parts.append(section(_title(function), function.settings))
    return "\n".join(parts)


def _title(function: Function) -> str:
    if function.most > 1:
        return f"`[[{function.key}]]`, up to {function.most}"
    return f"`[{function.key}]`" if function.always else f"`[{function.key}]`, there if it is given"


if __name__ == "__main__":
    sys.stdout.write(reference())
