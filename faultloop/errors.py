"""The one exception for wrong input: a file, a key, what is wrong and what would be right."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class InputError(ValueError):
    """Wrong input from a user.  ``str()`` is one line; the command line prints it and exits with status 2.

    Parameters
    ----------
    what : what is wrong, and what would be right.
    file : the file it stands in, if any.
    key : the key, channel, line or offset in that file, if any.
    """

    def __init__(self, what: str, *, file: object = None, key: str | None = None) -> None:
        self.what = " ".join(what.split())
        self.file = None if file is None else str(file)
        self.key = key
        super().__init__(": ".join(_printable(part) for part in (self.file, self.key, self.what) if part))

    def within(self, file: object) -> InputError:
        """The same error, with the file named (for code that parses text and does not know its file)."""
        return self if self.file else InputError(self.what, file=file, key=self.key)


def _printable(text: str) -> str:
    """A name may hold a line's end; the message is one line all the same."""
    return text if text.isprintable() else "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def nearest(name: str, known: Iterable[str]) -> str:
    """`` (did you mean 'x'?)`` or the list of known names: the tail of an unknown-name message."""
    known = list(known)
    match = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    if match:
        return f"did you mean '{match[0]}'?"
    return f"known: {', '.join(known)}" if known else "none are defined"
