"""Classes that are no whole search, for the mistakes of a configuration that names them."""

from __future__ import annotations

from islandgp.search.base import NoSettings


class Undeclared:
    """A search that does not declare what it takes of a guidance."""

    Settings = NoSettings

    def start(self) -> None:
        """Does nothing."""

    make = ask = tell = start


class Forgetful(Undeclared):
    """Has no type for its memory."""

    uses: frozenset[str] = frozenset()
