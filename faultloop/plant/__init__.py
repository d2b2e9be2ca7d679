"""The primary system: network, faults, breakers, and the front end of each relay."""

from faultloop.plant.plant import Change, Plant, PlantParts, Plants, PlantState

__all__ = ["Change", "Plant", "PlantParts", "PlantState", "Plants"]
