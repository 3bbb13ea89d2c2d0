"""The island of the paper (section 2.2.2): a robot among garbage, humanoids and chargers."""

from islandgp.domains.island.domain import Island

__all__ = ["Island"]
