"""Best robots in unseen worlds, under the task of each arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from islandgp.compare.champions import (
    champion_keys,
    champion_measures,
    evaluate_champions,
    library_trees,
    unseen_worlds,
)
from islandgp.compare.comparable import Comparison, compare_arms
from islandgp.compare.library import library_names
from islandgp.compare.tables import origin_of_best
from islandgp.domain import Outcome
from islandgp.evaluation.base import Job, Problem
from islandgp.evaluation.serial import Serial
from islandgp.seeding import Stream, stream
from tests.compare.fake_runs import TREE, config, fake_arm, fake_run, guidance, individual
from tests.samples import outcome

OTHER = "PatrolWaypoint\n"
(POOR,) = [text for text, name in library_names(config()).items() if name == "poor"]


class Recorder:
    """An evaluator that gives a world's place as fitness, from 0, and keeps what it was asked."""

    simulated = 0

    def __init__(self, setting: Problem) -> None:
        self.setting = setting
        self.jobs: list[Job] = []
        self.closed = False

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        self.jobs += jobs
        place = {seed: k for k, seed in enumerate(dict.fromkeys(j.seed for j in jobs))}
        return [
            outcome(fitness=float(k), pickups=2, interactions=1, deliveries=1, charges=k)
            for k in (place[j.seed] for j in jobs)
        ]

    def close(self) -> None:
        """See `Evaluator`."""
        self.closed = True


def _study() -> Comparison:
    arms = [
        fake_arm(name, [fake_run(name, s, generations=4) for s in (0, 1)])
        for name in ("expert", "baseline")
    ]
    return compare_arms(arms)


def test_every_champion_meets_the_same_unseen_worlds_in_the_last_stage() -> None:
    """One result a run and one a library tree; equal trees are simulated once."""
    recorders: list[Recorder] = []

    def make(setting: Problem) -> Recorder:
        recorders.append(Recorder(setting))
        return recorders[-1]

    results = evaluate_champions(_study(), make, worlds=3, trees={"a tree": OTHER})
    assert [(r.arm, r.seed) for r in results] == [
        ("expert", 0),
        ("expert", 1),
        ("baseline", 0),
        ("baseline", 1),
        ("a tree", None),
    ]
    (recorder,) = recorders
    assert {j.tree for j in recorder.jobs} == {TREE, OTHER}
    assert len(recorder.jobs) == 3 + 3
    assert {j.stage for j in recorder.jobs} == {3}
    assert recorder.closed
    assert (results[0].points, results[0].mean) == ((0.0, 1.0, 2.0), 1.0)
    assert results[0].reached == {"complete": 2 / 3, "excellent": 0.0}
    assert results[0].counters["charges"] == 1.0


def test_every_champion_is_scored_under_every_task() -> None:
    """Rewards of 100 and 1,000 a takeover: the same episodes, other points, in a cross table."""
    texts = {name: text for text, name in library_names(config()).items()}
    robot = individual("0.0", tree=texts["all_rounder"])
    arms = [
        fake_arm(
            f"arm{base}",
            [
                fake_run(
                    seed=s,
                    generations=4,
                    populations=[[robot]] * 4,
                    path=f"{base}-{s}",
                    rewards__events__interaction__base=base,
                    world__episode__length=200,
                )
                for s in (0, 1)
            ],
            f"rewards.events.interaction.base={base}",
        )
        for base in (100, 1000)
    ]
    study = compare_arms(arms)
    results = evaluate_champions(study, Serial, worlds=4, trees={})
    points = {(r.arm, r.seed, r.task): r.mean for r in results}
    assert len(points) == 2 * 2 * 2
    assert {r.own for r in results if r.arm == r.task.replace("interaction.base=", "arm")} == {True}
    low, high = (task.label for task in study.tasks)
    for arm in ("arm100", "arm1000"):
        assert points[arm, 0, high] > points[arm, 0, low]
        assert points[arm, 0, low] == points["arm100", 0, low]
    measures = champion_measures(study, results)
    assert tuple(m.key for m in measures) == champion_keys(study)
    assert measures[0].label == "Best robot in unseen worlds under interaction.base=100"
    assert measures[1].of(study.arms[0].runs[0]) == points["arm100", 0, high]


def test_unseen_worlds_are_those_of_nobody() -> None:
    """They come from a separate stream, the same for all, and not from 0 as in `play`."""
    study = _study()
    seeds = unseen_worlds(study, 100)
    assert seeds[:3] == unseen_worlds(study, 3)
    assert len(set(seeds)) == 100
    assert min(seeds) > 100_000
    assert seeds[0] == int(stream(0, Stream.UNSEEN).integers(2**32))


def test_worlds_of_runs_are_passed_over() -> None:
    """A world that any run of the study used is not unseen."""
    study = _study()
    first, second, third = unseen_worlds(study, 3)
    arm = study.arms[1]
    record = replace(arm.runs[0].records[0], worlds=(second,))
    met = replace(arm, runs=(replace(arm.runs[0], records=(record,)), arm.runs[1]))
    assert unseen_worlds(replace(study, arms=(study.arms[0], met)), 2) == (first, third)
    validated = replace(arm, runs=(replace(arm.runs[0], validation=(first, third)), arm.runs[1]))
    assert unseen_worlds(replace(study, arms=(study.arms[0], validated)), 1) == (second,)


def test_library_trees_are_beside_the_best_robots() -> None:
    """Reference trees first, then those for targets; the one injected most often is marked."""
    names = [*library_trees(_study())]
    assert names[:2] == ["library: all_rounder", "library: multi_behaviour"]
    target = names[-1].removeprefix("library: ")
    texts = {name: text for text, name in library_names(config()).items()}
    runs = [
        fake_run(seed=0, generations=4, guided=guidance(tree=texts[target], injected=True)),
        fake_run(seed=1, generations=4, guided=guidance(tree=texts["all_rounder"])),
    ]
    study = _study()
    trees = library_trees(replace(study, arms=(replace(study.arms[0], runs=tuple(runs)),)))
    assert trees[f"library: {target}"] == texts[target]


# 1.1 is injected and kept as an elite; 2.1 is its child; 3.1 is a copy of a random tree.
POPULATIONS = [
    [individual("0.0", "random"), individual("0.1", "random", tree=OTHER)],
    [individual("1.0", "crossover", ["0.0", "0.1"]), individual("1.1", "injected", tree=POOR)],
    [
        individual("2.0", "elite", ["1.1"], tree=POOR, fitness=9.0),
        individual("2.1", "crossover", ["1.0", "1.1"]),
    ],
    [
        individual("3.0", "resurrected", ["2.0"], tree=POOR, fitness=5000.0),
        individual("3.1", "copy", ["0.1"], tree=OTHER),
        individual("3.2", "elite", ["1.0"]),
        individual("3.3", "elite", ["1.0"], mutation="swap"),
        individual("3.4", "elite", ["1.1"], mutation="swap", tree=OTHER),
        individual("3.5", "injected", mutation="swap"),
        individual("3.6", "edited", mutation="edit:insert"),
    ],
]


def _origins(source: str = "expert", tree: str = POOR) -> list[str]:
    guided = guidance(tree=tree, injected=True, source=source)
    run = fake_run(best=[1.0, 1, 1, 2], populations=POPULATIONS, guided=guided)
    champions = (replace(run.champion, record=record) for record in run.records[3].individuals)
    return [origin_of_best(replace(run, champion=champion)) for champion in champions]


def test_copies_are_followed_back_to_where_the_tree_arose() -> None:
    """Drawn, bred, or given as it is, by the name of the library's file."""
    assert _origins() == [
        "injected, unchanged: poor",
        "a random tree",
        "bred",
        "bred",
        "bred, with an advised ancestor",
        "bred, with an advised ancestor",
        "edited by the supervisor",
    ]


def test_a_tree_from_outside_the_library_has_its_writer_s_name() -> None:
    """A language model's tree is called by its supervisor."""
    assert _origins("llm", OTHER)[0] == "injected, unchanged: llm"
