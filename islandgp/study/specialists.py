"""The rows of Table 13: two classes and two labels (section 3.8)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from islandgp.scoring.snapshot import Snapshot

SPECIALISTS: Final[dict[str, Callable[[Snapshot], int]]] = {
    "pickup": lambda s: s.specialists["pickup"],
    "humanoid": lambda s: s.specialists["humanoid"],
    "charging": lambda s: s.doing["charging"],
    "clearing": lambda s: s.doing["clearing"],
}
