"""What MLflow holds of a run, in a form that two runs can be compared by."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from islandgp.tracking.store import MLflowSettings, Store, TrackingStore

MEASURED = ("cost/", "run/seconds")  # differs from machine to machine


@dataclass(frozen=True)
class Tracked:
    """One MLflow run."""

    id: str
    name: str
    status: str
    parent: str | None
    params: dict[str, str]
    tags: dict[str, str]
    points: dict[str, list[tuple[int, float]]]  # step and value by metric, costs left out
    artifacts: set[str]


def store(home: Path) -> Store:
    """The default store of a folder in which a command was given."""
    return Store(
        TrackingStore.of(
            MLflowSettings(
                uri="sqlite:///mlflow.db",
                artifacts="mlartifacts",
                experiment="islandgp",
                patience=0,
            ),
            home,
        )
    )


def tracked(store: Store) -> list[Tracked]:
    """All runs, oldest first."""
    runs = store.client.search_runs([store.experiment], order_by=["attributes.start_time"])
    return [_tracked(store, run) for run in runs]


def _tracked(store: Store, run: Any) -> Tracked:
    client, key = store.client, run.info.run_id
    return Tracked(
        id=key,
        name=run.info.run_name,
        status=run.info.status,
        parent=run.data.tags.get("mlflow.parentRunId"),
        params=run.data.params,
        tags=run.data.tags,
        points={
            name: sorted((m.step, m.value) for m in client.get_metric_history(key, name))
            for name in run.data.metrics
            if not name.startswith(MEASURED)
        },
        artifacts={file.path for file in client.list_artifacts(key)},
    )
