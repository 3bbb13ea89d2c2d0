"""MiniGrid of the Farama Foundation: a robot searches for keys, doors and goals in a maze."""

from islandgp.domains.minigrid.domain import MiniGrid

__all__ = ["MiniGrid"]
