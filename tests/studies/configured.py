"""Settings composed with the configuration of `studies`."""

from __future__ import annotations

from functools import cache
from typing import Final

import islandgp
from islandgp.config.settings import Settings
from tests.running.commands import ROOT

CONF: Final = ROOT / "studies" / "conf"


@cache
def studied(*overrides: str) -> Settings:
    """The settings of a run with `--config-dir studies/conf`, by default with `search=paper`."""
    has_search = any(each.startswith(("search=", "experiment=")) for each in overrides)
    search = () if has_search else ("search=paper",)
    return islandgp.compose("tracking=off", *search, *overrides, config_dir=CONF).settings
