"""Classes that are no whole search, for the mistakes of a configuration that names them."""

from __future__ import annotations

from islandgp.search.base import NoSettings


class Unsaid:
    """Says not what it takes of a guidance."""

    Settings = NoSettings

    def start(self) -> None:
        """Does nothing."""

    make = ask = tell = start


class Forgetful(Unsaid):
    """Has no type for its memory."""

    uses: frozenset[str] = frozenset()
