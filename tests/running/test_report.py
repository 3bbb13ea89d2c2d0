"""The lines of a run's report."""

from __future__ import annotations

from pathlib import Path

import pytest

from islandgp.experiment import compose
from islandgp.records.values import best_robot, comparisons, sentences
from islandgp.running.report import proposals


def test_small_points_have_three_digits() -> None:
    """Returns from 0 to 1 are not all shown as 0 or 1, and no zero is negative."""
    champion = {
        "record": {"id": "3.1", "nodes": 9},
        "validation": {
            "worlds": [1, 2, 3],
            "mean": 0.7312,
            "low": -0.0,
            "high": 1.25,
            "reached": {},
            "comparisons": [{"name": "tree by_hand", "mean": 0.0312, "low": -0.2, "high": 12345.6}],
        },
        "front": [],
    }
    points = "0.731 points (95 %: 0 to 1.25) in 3 unseen worlds"
    result = f"Best robot: individual 3.1, not shortened: {points}"
    assert best_robot(champion) == result
    assert [*comparisons(champion)] == [
        "Against the tree by_hand in the same worlds: +0.0312 points (95 %: -0.2 to +12,346)"
    ]
    gain = "+0.0312 points (95 %: -0.2 to +12,346) against the tree by_hand"
    assert next(sentences({"champion": champion})) == f"{result}, {gain}."


def test_a_broken_plug_in_proposes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The run is finished, so neither a missing module nor an unreadable file is an error."""
    (tmp_path / "search").mkdir()
    for name, text in (("gone", "search: {factory: no_such:Thing}"), ("empty", ""), ("bad", "{")):
        (tmp_path / f"search/{name}.yaml").write_text(text)
    monkeypatch.setattr("islandgp.running.report.conf_folders", lambda: (tmp_path,))
    settings = compose("supervisor=baseline").settings
    lines = [*proposals(settings, {"first": {"complete": None}, "nothing_works": ""})]
    assert [line[:23] for line in lines] == ["Perhaps `start=FILE.bt`"]
    assert [*proposals(settings, {"first": {"complete": 3}, "nothing_works": ""})] == []
