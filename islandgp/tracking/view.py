"""A view of MLflow's runs page that shows the arms: charts and columns that matter, by arm.

MLflow keeps a shared view as a tag of the experiment, and opens it by its key
in the page's address. A page that does not know the key shows all runs.
"""

from __future__ import annotations

import json
from typing import Any, Final

from islandgp.tracking.store import Store

KEY: Final = "arms"
CHARTS: Final = (
    "fitness/max",
    "fitness/mean",
    "diversity/behavioral",
    "supervisor/mutation_rate",
)
"""Metrics by generation; each chart has a curve and a band for each arm. After the first two
comes a chart for each milestone of the runs."""

COLUMNS: Final = ("attributes.`Created`", "tags.`arm`", "tags.`seed`", "metrics.`run/score`")
"""Columns of the table, in MLflow's spelling. After them comes one for each milestone: the
generation of the first such robot."""

RECENT: Final = 100  # runs whose milestones are looked at
MOST: Final = 5  # milestones with a chart: a tag's text has 5000 characters


def runs_page(server: str, experiment: str, mode: str) -> str:
    """The address of the view, as CHART or TABLE: MLflow itself opens on an empty page."""
    query = f"workflowType=machine_learning&compareRunsMode={mode}&viewStateShareKey={KEY}"
    return f"{server}/#/experiments/{experiment}/runs?{query}"


def share_view(store: Store) -> None:
    """Makes the view known to the store."""
    text = json.dumps(_state(_milestones(store)), separators=(",", ":"))
    store.client.set_experiment_tag(store.experiment, f"mlflow.sharedViewState.{KEY}", text)


def _milestones(store: Store) -> list[str]:
    runs = store.client.search_runs([store.experiment], max_results=RECENT)
    named = [json.loads(run.data.params.get("classes.milestones", "[]")) for run in runs]
    return list(dict.fromkeys(tier for milestones in named for tier in milestones))[:MOST]


def _state(tiers: list[str]) -> dict[str, Any]:
    charts = [*CHARTS[:2], *(f"tiers/{tier}" for tier in tiers), *CHARTS[2:]]
    section = {"uuid": KEY, "name": "Arms", "display": True, "isReordered": False}
    return {
        "groupBy": {
            "aggregateFunction": "average",
            "groupByKeys": [{"mode": "tag", "groupByData": "arm"}],
        },
        "runsHiddenMode": "SHOW_ALL",
        "useGroupedValuesInCharts": True,
        "hideEmptyCharts": True,
        "selectedColumns": [*COLUMNS, *(f"metrics.`run/first_{tier}`" for tier in tiers)],
        "compareRunSections": [{**section, "deleted": False, "isGenerated": False}],
        "compareRunCharts": [_chart(name) for name in charts],
    }


def _chart(name: str) -> dict[str, Any]:
    return {
        "uuid": name,
        "type": "LINE",
        "metricSectionId": KEY,
        "metricKey": name,
        "selectedMetricKeys": [name],
        "runsCountToCompare": 100,
        "deleted": False,
        "isGenerated": False,
        "lineSmoothness": 0,
        "xAxisKey": "step",
        "selectedXAxisMetricKey": "",
        "yAxisKey": "metric",
        "yAxisExpressions": [],
        "scaleType": "linear",
        "xAxisScaleType": "linear",
        "range": {},
        "useGlobalXaxisKey": True,
        "useGlobalLineSmoothing": True,
        "ignoreOutliers": False,
    }
