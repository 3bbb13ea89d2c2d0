"""A run whose best robot was validated in a single world."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from islandgp.compare.arms import Arm, find
from islandgp.compare.measures import read_runs
from islandgp.evolution.validation import Candidate, compared, validate
from islandgp.records.folder import RunFolder
from islandgp.records.values import run_values
from islandgp.results import load
from islandgp.running.report import report
from tests.composed import composed
from tests.evolution.fake import Fake
from tests.samples import best_of, outcome
from tests.tracking.folders import archive, begun, steps, summary_of


def _validated_once(path: Path, home: Path) -> RunFolder:
    """A finished run with one candidate, which met one world and another tree there."""
    folder, finished_steps = begun(path, home), steps()
    for step in finished_steps:
        folder.append(step)
    champion = finished_steps[-1].champion
    candidate = Candidate(0, champion.record.id, champion.record.tree, champion.record.fitness)
    (_, validation), *_ = validate(
        [candidate],
        [123],
        Fake(),
        0,
        composed().classes,
        episodes=1,
    )
    same = compared("good tree", [outcome(1.0)], [outcome(1.0)])
    best = best_of(champion, replace(validation, comparisons=(same,)))
    folder.finish(summary_of(folder, steps()[-1], best), archive(steps()[-1]))
    folder.close()
    return folder


def test_an_interval_of_one_world_is_null_in_the_summary(tmp_path: Path) -> None:
    """The file is JSON, with null for the four ends; its readers accept them."""
    folder = _validated_once(tmp_path / "run", tmp_path)
    text = (folder.path / "summary.json").read_text(encoding="utf-8")
    assert "NaN" not in text
    validation = json.loads(text)["champion"]["validation"]
    assert [validation[end] for end in ("low", "high")] == [None] * 2
    none = {"name": "good tree", "mean": 0, "low": None, "high": None}
    assert validation["comparisons"] == [none]
    assert run_values(folder.summary())["validation_mean"] == validation["mean"]
    assert load(tmp_path).runs["validation_mean"][0] == validation["mean"]
    _, runs = read_runs([Arm("a", "", tuple(find([tmp_path])))])
    assert 123 in runs["worlds"].item()


def test_the_report_of_such_a_run_gives_the_reason(tmp_path: Path) -> None:
    """No interval is shown, and the reason is."""
    lines = report(_validated_once(tmp_path / "run", tmp_path), []).splitlines()
    assert lines[0].endswith("points (no interval: one world) in 1 unseen world")
    (line,) = (line for line in lines if line.startswith("Against the good tree"))
    assert line.endswith("+0 points (no interval: one world)")
