"""A view of MLflow's runs page that shows the arms: charts that matter, grouped by arm.

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

RECENT: Final = 100  # runs whose milestones are looked at
MOST: Final = 5  # milestones with a chart: a tag's text has 5000 characters


def runs_page(server: str, experiment: str, view: str = "") -> str:
    """The address of the runs with their charts: MLflow itself opens on an empty page."""
    query = "workflowType=machine_learning&compareRunsMode=CHART"
    shared = f"&viewStateShareKey={view}" if view else ""
    return f"{server}/#/experiments/{experiment}/runs?{query}{shared}"


def share_view(store: Store) -> None:
    """Makes the view known to the store."""
    text = json.dumps(_state(_charts(store)), separators=(",", ":"))
    store.client.set_experiment_tag(store.experiment, f"mlflow.sharedViewState.{KEY}", text)


def _charts(store: Store) -> list[str]:
    runs = store.client.search_runs([store.experiment], max_results=RECENT)
    named = [json.loads(run.data.params.get("classes.milestones", "[]")) for run in runs]
    tiers = list(dict.fromkeys(tier for milestones in named for tier in milestones))
    return [*CHARTS[:2], *(f"tiers/{tier}" for tier in tiers[:MOST]), *CHARTS[2:]]


def _state(charts: list[str]) -> dict[str, Any]:
    section = {"uuid": KEY, "name": "Arms", "display": True, "isReordered": False}
    return {
        "groupBy": {
            "aggregateFunction": "average",
            "groupByKeys": [{"mode": "tag", "groupByData": "arm"}],
        },
        "runsHiddenMode": "SHOW_ALL",
        "useGroupedValuesInCharts": True,
        "hideEmptyCharts": True,
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
