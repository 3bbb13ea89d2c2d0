"""A comparison of runs from a world that the study has never heard of."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from islandgp.domains.island.vocabulary import SCHEMA
from islandgp.errors import StudyError
from islandgp.evaluation.serial import Serial
from islandgp.study.arms import Arm, Run
from islandgp.study.comparable import compare_arms
from islandgp.study.generalise import Generalisation, generalise
from islandgp.study.library import library_names
from islandgp.study.report import ComparisonReport, build
from islandgp.study.writing import runs_csv, to_markdown
from islandgp.trust import trust, trusting
from tests.samples import CLASSES
from tests.study.fake_runs import config, fake_arm, fake_run, guidance, individual

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
    for g, record in enumerate(run.records):
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
            best=one.fitness,
            specialists={"idler": 0, "turning": 1, "odd": 0},
            behaviour_counts={"turning": 1},
            tiers={name: int(name in one.tiers) for name in TIERS},
            counters=dict(one.counters),
        )
        records.append(replace(record, snapshot=snapshot, individuals=(one,)))
    champion = replace(run.champion, generation=5, record=records[5].individuals[0])
    changes: dict[str, Any] = {**config(supervisor, seed), **MAZE}
    flat = {k: v for k, v in run.flat.items() if k.partition(".")[0] not in MAZE}
    flat["domain.factory"] = "nowhere.maze:Maze"
    return replace(run, config=changes, flat=flat, records=tuple(records), champion=champion)


def _arms() -> list[Arm]:
    return [fake_arm(n, [_maze_run(n, s) for s in (0, 1)]) for n in ("expert", "baseline")]


UNSEEN = (Generalisation("expert", 0, 50.0, (40.0,) * 9, dict.fromkeys(TIERS, 0.5)),)


@pytest.fixture(scope="module")
def report(blank_module: None) -> ComparisonReport:  # noqa: ARG001 -- figures are not rendered
    """Two arms in a maze whose class cannot even be imported."""
    return build(compare_arms(_arms()), UNSEEN, 9)


def test_every_milestone_behaviour_and_component_has_its_row(report: ComparisonReport) -> None:
    """However many there are, by the names that configuration and records give them."""
    tables = {t.key: t for t in report.tables}
    firsts = [row[0] for row in tables["table-11"].rows]
    assert firsts == [f"First {name.capitalize()} Robot" for name in TIERS]
    assert tables["table-11-runs"].rows[0][1:5] == ("2", "4", "never", "never")
    assert [row[0] for row in tables["table-13"].rows] == ["Turning"]
    assert [row[0] for row in tables["components"].rows] == ["Way", "Fitness"]
    assert [c for c in tables["generalisation"].columns if c.endswith(" in")] == [
        f"{name.capitalize()} in" for name in TIERS
    ]
    assert runs_csv(compare_arms(_arms())).startswith("arm,seed")


def test_the_first_two_arms_are_a_family(report: ComparisonReport) -> None:
    """By the measures of Tables 9 to 12."""
    family = "Family 'the first two arms': expert and baseline, each by 16 measures"
    assert family in report.sections[-1].items[1]


def test_unseen_worlds_need_the_domain() -> None:
    """Where its class cannot be imported the message names it, and what to do."""
    with trusting():
        trust(["nowhere.maze:Maze"])
        with pytest.raises(StudyError, match=r"domain nowhere\.maze:Maze here, .* --worlds 0"):
            generalise(compare_arms(_arms()), Serial, worlds=1, reference_trees={})


def test_no_word_of_the_island_is_in_the_report(report: ComparisonReport) -> None:
    """Neither its actions and keys, nor its counters, classes and tiers."""
    names = {
        *SCHEMA.vocabulary.actions,
        *SCHEMA.vocabulary.keys,
        *SCHEMA.components,
        *SCHEMA.counters,
        *CLASSES.behaviours,
    } - {"patrol", "distance", "inactive", "battery", "idle"}
    text = re.sub(r"(selector|MoveToGarbage|PatrolWaypoint)", "", to_markdown(report)).lower()
    assert {name for name in names if re.search(rf"\b{name.lower()}\b", text)} == set()


def test_library_trees_have_the_names_of_the_run_s_folder(tmp_path: Path) -> None:
    """Of the folder that the configuration names; none, or one that is gone, names nothing."""
    (tmp_path / "mine.bt").write_text("domain island\nPatrolWaypoint\n")
    (tmp_path / "half.bt").write_text("selector {")
    assert library_names(config(library__folder=str(tmp_path))) == {"PatrolWaypoint\n": "mine"}
    assert library_names(config(library__folder=None)) == {}
    assert library_names(config(library__folder="gone")) == {}
    assert library_names({**config(), **MAZE}) == {}


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
    folder = Path(__file__).parents[2] / "islandgp" / "study"
    places = [
        (path.name, word)
        for path in sorted(folder.rglob("*.py"))
        for word in ISLAND_WORDS
        if word in path.read_text(encoding="utf-8").lower()
    ]
    assert places == []
