"""`--config-dir` and `--trust`: which code and servers of a run's folder a command may use."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

import click

from islandgp.trust import EVERYTHING, trust, trust_folder, trusting


def with_trust_options(command: Callable[..., None]) -> Callable[..., None]:
    """Adds both options to a command that reads runs; what they name is trusted while it works."""

    @wraps(command)
    def runs(*, config_dir: Path | None, trust_all: bool, **arguments: Any) -> None:
        with trusting():
            if config_dir is not None:
                trust_folder(config_dir)
            if trust_all:
                trust([EVERYTHING])
            command(**arguments)

    runs = click.option(
        "--config-dir",
        type=click.Path(exists=True, file_okay=False, path_type=Path),
        help="Folder with your configuration; its classes and servers are trusted.",
    )(runs)
    return click.option(
        "--trust",
        "trust_all",
        is_flag=True,
        help="Trust the classes and servers named in the runs. Their code is executed.",
    )(runs)
