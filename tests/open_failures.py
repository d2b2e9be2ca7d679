"""Tests that failed when all work was first run together, and were not looked into: each is an open fault.

They run and are told as expected failures, so that nobody takes them for passed. Mend, and delete the line.
"""

OPEN: tuple[str, ...] = ()
