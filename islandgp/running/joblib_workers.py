"""joblib's worker processes: they end with the sweep that started them, also when it is killed."""

from __future__ import annotations

import os
from functools import partial
from typing import Any

from islandgp.evaluation.parent_death import end_with_parent


def tie_joblib_workers() -> None:
    """Makes the workers that joblib starts from now on end with this process."""
    from joblib import register_parallel_backend  # type: ignore[import-untyped] # as above
    from joblib.parallel import LokyBackend  # type: ignore[import-untyped] # it has no types

    class Tied(LokyBackend):  # type: ignore[misc] # joblib has no types
        def configure(self, *args: Any, **options: Any) -> Any:
            """Gives joblib's executor a function that each worker calls at its start."""
            return super().configure(
                *args, initializer=partial(end_with_parent, os.getpid()), **options
            )

    register_parallel_backend("loky", Tied)  # by which name Hydra's launcher asks for it
