"""Environments of Gymnasium with numeric observations, as domains by configuration."""

from islandgp.domains.gymnasium.domain import Gymnasium

__all__ = ["Gymnasium"]
