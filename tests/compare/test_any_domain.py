"""A comparison of runs from a world that the study has never heard of."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from islandgp.compare.arms import Arm, Run
from islandgp.compare.champions import evaluate_champions, library_trees
from islandgp.compare.comparable import compare_arms
from islandgp.compare.report import Report, build
from islandgp.domains.island.vocabulary import SCHEMA
from islandgp.errors import RunError
from islandgp.evaluation.serial import Serial
from islandgp.gate import user_folder
from islandgp.records.folder import RunFolder
from tests.compare.fake_runs import config, fake_arm, fake_run, guidance, individual, written
from tests.records.configured import naming
from tests.samples import CLASSES

TIERS = ("begun", "halfway", "nearly", "arrived")

MAZE = {
    "domain": {"factory": "nowhere.maze:Maze"},
    "world": {"size": 9},
    "library": {"folder": None, "trees": {}, "examples": {}},
    "classes": {
        "behaviours": {"turning": "turns"},
        "specialists": {"of": ["turning"], "dominance_ratio": 2.0, "idle": "idler", "mixed": "odd"},
        "tiers": {name: {"at_least": {"turns": k}} for k, name in enumerate(reversed(TIERS))},
        "milestones": list(TIERS),
    },
}


def _maze_run(supervisor: str, seed: int) -> Run:
    """A run in a maze: one component, one behaviour, four milestones."""
    plain = individual("0.0")
    run = fake_run(supervisor, seed, generations=6, guided=guidance(pattern="stagnation"))
    records = []
    for g, record in enumerate(RunFolder(run.path).generations()):
        one = replace(
            plain,
            id=f"{g}.0",
            origin="injected" if g == 3 else "crossover",
            parents=(f"{g - 1}.0",) if g else (),
            fitness=10.0 * g + seed,
            components={"way": 10.0 * g + seed},
            counters={"turns": float(g)},
            specialist="turning",
            tiers=TIERS[: g // 2],
        )
        snapshot = replace(
            record.snapshot,
            fitness_max=one.fitness,
            specialists={"idler": 0, "turning": 1, "odd": 0},
            behaviour_counts={"turning": 1},
            tiers={name: int(name in one.tiers) for name in TIERS},
            counters=dict(one.counters),
        )
        records.append(replace(record, snapshot=snapshot, individuals=(one,)))
    return written(run.path / "maze", records, {**run.config, **MAZE})


def _arms() -> list[Arm]:
    return [fake_arm(n, [_maze_run(n, s) for s in (0, 1)]) for n in ("expert", "baseline")]


@pytest.fixture(scope="module")
def report() -> Report:
    """Two arms in a maze whose class cannot even be imported; figures are not drawn."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("islandgp.compare.figures.to_svg", lambda *_, **__: "")
        return build(compare_arms(_arms()))


def test_every_milestone_behaviour_and_component_has_its_row(report: Report) -> None:
    """However many there are, by the names that configuration and records give them."""
    tables = report.tables
    labels = list(tables["differences expert baseline"]["Measure"])
    assert [label for label in labels if label.startswith("First")] == [
        f"First {name.capitalize()} Robot" for name in TIERS
    ]
    assert list(tables["behaviours"]["Behaviour"]) == ["Turning"]
    assert list(tables["components"]["Component"]) == ["Way", "Fitness"]
    assert list(report.study.runs["first.halfway"])[:1] == [4]


def test_unseen_worlds_need_the_domain(tmp_path: Path) -> None:
    """Where its class cannot be imported the message names it, and what to do."""
    message = r"No module named 'nowhere'.*; install what it names"
    folder = naming(tmp_path, "nowhere.maze:Maze")
    with user_folder(folder), pytest.raises(RunError, match=message):
        evaluate_champions(compare_arms(_arms()), Serial, worlds=1, trees={})


def test_no_word_of_the_island_is_in_the_report(report: Report) -> None:
    """Neither its actions and keys, nor its counters, classes and tiers."""
    names = {
        *SCHEMA.vocabulary.actions,
        *SCHEMA.vocabulary.keys,
        *SCHEMA.components,
        *SCHEMA.counters,
        *CLASSES.behaviours,
    } - {"patrol", "distance", "inactive", "battery", "idle"}
    page = re.sub(r'"data:[^"]*"', "", report.files["index.html"])
    text = re.sub(r"(selector|MoveToGarbage|PatrolWaypoint)", "", page).lower()
    assert {name for name in names if re.search(rf"\b{name.lower()}\b", text)} == set()


def test_a_library_that_is_not_here_has_no_trees() -> None:
    """A folder that is gone, none, or that of a domain that cannot be imported."""
    assert len(library_trees(config(), for_targets=False)) == 2
    assert library_trees(config(library__folder=None)) == {}
    assert library_trees(config(library__folder="gone")) == {}
    assert library_trees({**config(), **MAZE}) == {}


ISLAND_WORDS = (
    "island.",
    "complete",
    "excellent",
    "pickup",
    "humanoid",
    "charging",
    "clearing",
    "garbage",
    "patrol",
    "all_rounder",
    "grammar/examples",
)


def test_no_word_of_the_island_is_in_the_code() -> None:
    """What the study knows of a domain it knows from configuration and records."""
    folder = Path(__file__).parents[2] / "islandgp" / "compare"
    places = [
        (path.name, word)
        for path in sorted(folder.rglob("*.py"))
        for word in ISLAND_WORDS
        if word in path.read_text(encoding="utf-8").lower()
    ]
    assert places == []
