"""The MLflow stores of the commands `sync` and `ui`."""

from __future__ import annotations

from pathlib import Path

from hydra._internal.utils import get_args_parser
from pydantic import ValidationError

from islandgp.config.compose import composed_config, resolved
from islandgp.config.errors import error_lines
from islandgp.config.sources import ConfigSource
from islandgp.errors import ConfigError
from islandgp.tracking.store import MLflowSettings, TrackingStore
from islandgp.tracking.sync import FACTORY


def stores(config_dir: Path | None, home: Path) -> list[TrackingStore]:
    """The MLflow stores that configuration names, those of the user's folder first.

    Raises ConfigError for a wrong file.
    """
    flags = [] if config_dir is None else ["--config-dir", str(config_dir)]
    source = ConfigSource.of(get_args_parser().parse_args(flags))
    places = []
    for option in source.options("tracking"):
        part = resolved(composed_config([f"tracking={option}"], source).tracking)
        if part.get("factory") == FACTORY:
            policy = part.get("policy")
            try:
                settings = MLflowSettings.model_validate(policy)
            except ValidationError as error:
                lines = error_lines(error, policy, f"tracking={option}: policy")
                raise ConfigError("\n".join(lines)) from None
            is_ours = (source.folder / "tracking" / f"{option}.yaml").is_file()
            places.append((is_ours, option, TrackingStore.of(settings, home)))
    return [place for *_, place in sorted(places, key=lambda each: each[:2])]
