"""One clock: plant, relays, bus and breakers in one process; from a scenario, or a record, to a result."""
