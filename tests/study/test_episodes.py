"""What runs cost in episodes, and their curves by episodes."""

from __future__ import annotations

from dataclasses import replace
from operator import attrgetter
from typing import Any

import pytest

from islandgp.gp.record import Cost
from islandgp.study.arms import Arm, Run
from islandgp.study.comparable import compare_arms
from islandgp.study.episodes import (
    EpisodeCost,
    cost_warnings,
    episode_cost,
    episodes_until,
)
from islandgp.study.figures.episodes import at_episodes, by_episodes
from islandgp.study.tables.supervision import episodes_table
from tests.study.fake_runs import TREE, fake_arm, fake_run, guidance

best = attrgetter("best")


def _run(*episodes: int, seed: int = 0, **changes: Any) -> Run:
    """A run whose generations asked for so many episodes, each as fit as its number."""
    run = fake_run("expert", seed, best=[float(g) for g in range(len(episodes))], **changes)
    return replace(run, costs=tuple(Cost(1.0, 0.0, 0.0, n, n) for n in episodes))


def test_episodes_are_those_of_the_costs() -> None:
    """Summed up to the end of each generation."""
    assert episodes_until(_run(30, 30, 10, 2)) == (30, 60, 70, 72)


def test_without_costs_they_are_those_of_the_configuration() -> None:
    """Population times episodes an individual."""
    run = _run(0, 0, 5, gp__population=20, gp__episodes=3)
    assert episodes_until(run) == (60, 120, 125)


def _arm(name: str, *runs: Run) -> Arm:
    return fake_arm(name, runs)


def test_curves_of_runs_with_unequal_episodes() -> None:
    """At each number of episodes that all runs have reached: the last finished generation."""
    places, rows = at_episodes(_arm("a", _run(10, 10, 10), _run(15, 10, seed=1)), best)
    assert places == [15, 20, 25]
    assert rows == [[0, 1, 1], [0, 0, 1]]


def test_curves_of_runs_with_equal_episodes() -> None:
    """They are the generations' values, on another scale."""
    places, rows = at_episodes(_arm("a", _run(10, 20, 10), _run(10, 20, 10, seed=1)), best)
    assert places == [10, 30, 40]
    assert rows == [[0, 1, 2]] * 2


def _costing(name: str, episodes: int, **changes: Any) -> Arm:
    runs = [_run(*[episodes] * 4, seed=s, path=f"runs/{name}/{s}", **changes) for s in (0, 1)]
    return fake_arm(name, runs)


def test_unequal_cost_is_noted() -> None:
    """In the comparison's notes, which terminal and report show; equal cost is not."""
    same = compare_arms([_costing("a", 30), _costing("b", 30)], force=True)
    assert not any("unequal cost" in text for text in same.notes)
    study = compare_arms([_costing("a", 300), _costing("b", 30), _costing("c", 30)], force=True)
    assert (
        "Warning: arms of unequal cost: arm a used 1,200 episodes a run, arm b 120, arm c 120."
        in study.notes
    )


def test_runs_that_are_cut_cost_what_is_compared() -> None:
    """Generations that no measure sees are in no cost."""
    long = fake_arm("a", [_run(*[30] * 9, seed=s, path=f"long/{s}") for s in (0, 1)])
    study = compare_arms([long, _costing("b", 30)], force=True)
    assert not any("unequal cost" in text for text in study.notes)


def test_everything_that_costs_episodes_counts() -> None:
    """Generations, the supervisor's own, validation where there was one; the library apart."""
    run = _run(30, 30, 30, 30, gp__population=30, gp__validation=0.5, library__folder=None)
    costs = tuple(replace(c, llm={"episodes": 2.0 * g}) for g, c in enumerate(run.costs))
    trees = replace(run.records[0], guidance=guidance(tree=TREE))
    with_supervisor = replace(
        run, costs=costs, validation=(1, 2), records=(trees, *run.records[1:])
    )
    behaviours = len(run.classes.behaviours)
    cost = episode_cost(_arm("a", with_supervisor))
    assert cost == EpisodeCost(120, 6, 60, (200 + behaviours * 450) * 2)
    assert cost.total == 186
    assert episode_cost(_arm("a", run)) == EpisodeCost(120, 0, 0, 0)  # no trees: no search


def test_a_library_that_one_arm_searched_is_noted() -> None:
    """Unless all arms have it, or trees are from a folder."""
    trees = guidance(tree=TREE)
    searched = _costing("a", 30, guided=trees, library__folder=None)
    from_folder = _costing("b", 30, guided=trees)
    (text,) = cost_warnings([searched, from_folder])
    assert "the trees of a come from a search for a library of about" in text
    assert list(cost_warnings([searched, replace(searched, name="b")])) == []
    assert list(cost_warnings([from_folder, replace(from_folder, name="c")])) == []


def test_the_table_of_episodes() -> None:
    """A row for each arm; a dash where no library was searched."""
    study = compare_arms([_costing("a", 300), _costing("b", 30)], force=True)
    table = episodes_table(study)
    assert table.rows == (
        ("a", "1,200", "0", "0", "1,200", "\N{EN DASH}"),
        ("b", "120", "0", "0", "120", "\N{EN DASH}"),
    )


@pytest.mark.usefixtures("blank")
@pytest.mark.parametrize(
    "runs",
    [
        (_run(10, 10, 10, 10), _run(1, 1, 1, 1, seed=1)),  # one ends before the other begins
        (_run(10, 10, 10, 10, complete=2), _run(20, 10, 10, 10, seed=1, complete=3)),
        (_run(10, 10, 10, 10, complete=0),),
    ],
)
def test_any_runs_have_curves_by_episodes(runs: tuple[Run, ...]) -> None:
    """Runs of one arm may differ in cost, or be only one."""
    study = compare_arms([_arm("a", *runs), _costing("b", 30)], force=True)
    assert by_episodes(study).caption
