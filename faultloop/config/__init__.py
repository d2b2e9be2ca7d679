"""TOML files to validated models: what a scenario says that belongs to no component of plant or relay."""
