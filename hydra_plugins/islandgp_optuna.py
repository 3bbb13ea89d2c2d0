"""The sweeper of `hydra/sweeper=optuna`, which Hydra finds here; it runs `sweep.optuna_trials`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hydra.core.plugins import Plugins
from hydra.plugins.sweeper import Sweeper
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig


class OptunaSweeper(Sweeper):
    """A search by Optuna, with the keys of `conf/hydra/sweeper/optuna.yaml`."""

    def __init__(self, **settings: Any) -> None:
        self.settings = settings

    def setup(
        self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig
    ) -> None:
        """See `Sweeper`."""
        self.folder = Path(config.hydra.sweep.dir)
        self.hydra_context, self.config = hydra_context, config
        self.launcher = Plugins.instance().instantiate_launcher(
            hydra_context=hydra_context, task_function=task_function, config=config
        )

    def sweep(self, arguments: list[str]) -> None:
        """Runs the search. See `Sweeper`."""
        from islandgp.sweep.optimiser import RESULTS
        from islandgp.sweep.optuna_trials import search

        assert self.launcher is not None, "Hydra calls setup first"
        search(arguments, self.launcher.launch, self.folder / RESULTS, **self.settings)
