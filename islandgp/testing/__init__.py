"""Checks that a domain keeps the promises of `islandgp.domain`."""

from islandgp.testing.check import Check, check_domain

__all__ = ["Check", "check_domain"]
