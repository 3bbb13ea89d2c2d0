"""An island whose episodes hang while a file exists: a simulator that does not answer."""

from __future__ import annotations

import os
from pathlib import Path
from time import sleep
from typing import Any

from islandgp.domain import Outcome
from islandgp.domains.island import Island


class HangingIsland(Island):
    """Hangs while the file exists that the environment variable ISLAND_HANGS names."""

    def run_episode(self, *args: Any, **options: Any) -> Outcome:
        """See `Domain`."""
        while Path(os.environ["ISLAND_HANGS"]).exists():
            sleep(0.1)
        return super().run_episode(*args, **options)
