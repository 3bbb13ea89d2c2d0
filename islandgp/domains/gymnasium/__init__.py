"""Any environment of Gymnasium with numbers to observe and actions to choose, by configuration."""

from islandgp.domains.gymnasium.domain import Gymnasium

__all__ = ["Gymnasium"]
