"""`make comparators`: a run of an arm, its score and its curve."""

from __future__ import annotations

from pathlib import Path

import pytest

from studies.comparison.compare_searches import WORLDS, World, measured


def test_a_run_has_a_score_a_tree_and_a_curve(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The curve ends at the budget; the robot is evaluated in the unseen worlds."""
    small = ("domain=cartpole", "gp.population=6", "budget.episodes=30", "gp.validation=0.2")
    monkeypatch.setitem(WORLDS, "small", World(small, Path("none.bt")))
    monkeypatch.setattr("studies.comparison.compare_searches.UNSEEN", range(3))
    monkeypatch.chdir(tmp_path)
    run = measured("small", "racing", 1)
    assert run["score"] > 0
    assert run["tree"].startswith(("sequence", "selector", "when", "parallel", "Push"))
    episodes = [point[0] for point in run["curve"]]
    assert episodes == sorted(episodes)
    assert 0 < episodes[-1] <= 30
