"""`search=plans` learns what actions need and give, and chains them."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from chain import SCHEMA, chain
from click.testing import CliRunner

import islandgp
from islandgp.bt.core.language import parse, parse_condition, to_text
from islandgp.bt.core.node import selector
from islandgp.bt.core.printer import condition_text, head
from islandgp.cli import islandgp as command
from islandgp.domain import Action, Condition, Vocabulary, enumeration
from islandgp.evaluation.base import Evaluator, Problem
from islandgp.evaluation.processes import Processes
from islandgp.evaluation.serial import Serial
from islandgp.evolution.loop import evolve
from islandgp.gp.evidence import digest
from islandgp.gp.plan import Plan
from islandgp.gp.record import RunState, Step
from islandgp.records.checkpoint import read_checkpoint, save_state
from islandgp.records.folder import RunFolder
from islandgp.running.parts import make_search
from islandgp.running.report import report
from islandgp.scoring.classes import Classes
from islandgp.scoring.curriculum import Curriculum
from islandgp.search.racing import RacingMemory
from islandgp.supervision.base import GenerationView
from islandgp_plans.action_models import ActionModel, ActionSample, Learner, recorded
from islandgp_plans.action_observer import ActionObserver
from islandgp_plans.neutral import Screen
from islandgp_plans.planning import Planner, branches
from islandgp_plans.plans import Plans, PlansMemory
from islandgp_plans.policies import best_policy
from tests.composed import composed
from tests.evolution.runs import Constant, lines
from tests.running.commands import ROOT

VOCABULARY = SCHEMA.vocabulary
CLASSES = {
    "behaviours": {"opening": "opened"},
    "specialists": {"of": ["opening"], "dominance_ratio": 2.0, "idle": "idle", "mixed": "mixed"},
    "tiers": {"opener": {"at_least": {"opened": 1}}},
    "milestones": ["opener"],
}
CURRICULUM = {"generations_per_epoch": 5, "stages": [{"epochs": (1, 1), "multipliers": {}}]}
PROBLEM = Problem(chain(), Curriculum.model_validate(CURRICULUM), observer=ActionObserver)


@cache
def parts() -> tuple[Plans, Plan]:
    """The search and the plan of a run with 25 generations of 12 individuals."""
    settings = composed(
        *("search=plans", "supervisor=baseline", "gp.population=12", "gp.generations=25"),
        *("search.policy.random_generations=1", "search.policy.library=0"),
    )
    plan = replace(
        settings.plan(settings.make_domain()),
        vocabulary=VOCABULARY,
        curriculum=PROBLEM.curriculum,
        classes=Classes.model_validate(CLASSES),
    )
    search = make_search(settings, plan)
    assert isinstance(search, Plans)
    return search, plan


def run(evaluator: Evaluator | None = None, start: RunState | None = None) -> list[Step]:
    """The steps of the run."""
    search, plan = parts()
    evaluator = evaluator or Serial(PROBLEM)
    return list(evolve(plan, 1, Constant(0), evaluator, search=search, start=start))


@cache
def straight() -> list[Step]:
    """The steps of an uninterrupted run in this process."""
    return run()


def models() -> dict[str, ActionModel]:
    """What the run learned."""
    state = straight()[-2].state
    assert state is not None
    search, _ = parts()
    return search.models(state.memory)


def words(terms: object) -> set[str]:
    """Conditions as texts."""
    return {condition_text(term) for term in terms}  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("action", "needs", "gives"),
    [
        ("Drive", set(), {"place == shelf"}),
        ("Drive(to: door)", set(), {"place == door"}),
        ("Fetch(key: blue)", {"place == shelf"}, {"held == blue"}),
        ("Open", {"place == door", "held == lock", "holding"}, {"not holding"}),
    ],
)
def test_the_learned_models_are_right(action: str, needs: set[str], gives: set[str]) -> None:
    """The keys that a success needs, alone or equal to another key, and those that it changes."""
    model = models()[action]
    assert words(model.needs) == needs
    assert gives <= words(model.gives)
    assert model.sentence.startswith(f"{action} needs ")


def test_a_run_finds_the_chain() -> None:
    """Racing with as many episodes earns a fraction of it."""
    best = max(i.fitness for step in straight()[-5:] for i in step.record.individuals)
    assert best >= 40  # the tree by hand earns 50 to 60


def test_workers_and_resumed_runs_have_the_same_records(tmp_path: Path) -> None:
    """The samples of actions travel with the outcomes, and the records of actions are kept."""
    processes = Processes(PROBLEM, 2)
    try:
        assert list(lines(run(processes))) == list(lines(straight()))
    finally:
        processes.close()
    state = straight()[15].state
    assert state is not None
    save_state(tmp_path / "checkpoint.json", state)
    checkpoint, _ = read_checkpoint(tmp_path / "checkpoint.json")
    rest = run(start=replace(checkpoint, history=state.history))
    assert list(lines(rest)) == list(lines(straight()))[16:]
    assert (tmp_path / "checkpoint.json").stat().st_size < 200_000


class Reader(Constant):
    """A supervisor that reads what the search has learned."""

    read: tuple[str, ...] = ()

    def on_generation(self, generation: GenerationView) -> None:
        """See `GenerationListener`."""
        self.read = generation.learned


def test_a_supervisor_is_told_what_was_learned() -> None:
    """The sentences of the actions, as after the run."""
    search, plan = parts()
    reader = Reader(0)
    *_, before, _, _ = evolve(plan, 1, reader, Serial(PROBLEM), search=search)
    assert before.state is not None
    assert list(reader.read) == search.findings(before.state.memory)
    assert any(sentence.startswith("Open needs ") for sentence in reader.read)


def test_a_plan_achieves_what_an_action_needs_in_order() -> None:
    """The key of the lock first, as fetching it needs another place than the door."""
    learned = {text: m for text, m in models().items() if m.starts}
    planner = Planner(VOCABULARY, learned)
    tree = selector(*branches(planner.plan(np.random.default_rng(0), learned["Open"]), "none"))
    outcomes = [chain().run_episode(tree, seed, {}) for seed in range(5)]
    assert min(o.fitness for o in outcomes) >= 40
    assert to_text(tree).count("Open") == 1


@pytest.mark.parametrize(
    ("tree", "action", "expected"),
    [
        ("Fetch", "Fetch", [(False, ())]),
        ("sequence { Drive Fetch }", "Drive", [(True, ())]),
        ("sequence { Drive Fetch }", "Fetch", [(True, ())]),
        ("selector { Open Fetch }", "Fetch", [(False, ("place == yard",))]),
    ],
)
def test_samples_of_an_episode(
    tree: str, action: str, expected: list[tuple[bool, tuple[str, ...]]]
) -> None:
    """The start is unknown after a success in the same tick if the action ends in that tick."""
    node = parse(tree, VOCABULARY)
    observer = ActionObserver(node, VOCABULARY)
    chain().run_episode(node, 0, {}, observer)
    found = [s for s in observer.result() if s.action == action]
    assert {s.succeeded for s in found} == {succeeded for succeeded, _ in expected}
    assert any(s.start for s in found) == (action != "Fetch" or not tree.startswith("sequence"))
    for _, terms in expected:
        for term in terms:
            starts = np.array([s.start for s in found])
            condition = parse_condition(term, VOCABULARY)
            assert Learner(VOCABULARY).holds(condition, starts).all()  # type: ignore[arg-type]


def test_declarations_are_evidence_of_actions_that_were_never_tried() -> None:
    """`to_start` are needs, and `gives` are effects with which a plan can be made at once."""
    actions = {
        **VOCABULARY.actions,
        "Drive": replace(
            VOCABULARY.actions["Drive"], gives=(Condition("place", "==", 0.0, "door"),)
        ),
        "Open": replace(
            VOCABULARY.actions["Open"], to_start=(Condition("place", "==", 0.0, "door"),)
        ),
    }
    search, plan = parts()
    declared = Plans(
        search.settings, replace(plan, vocabulary=replace(VOCABULARY, actions=actions)), []
    )
    models = declared.models(PlansMemory(RacingMemory((), ())))
    planner = Planner(plan.vocabulary, models)
    rules = planner.plan(np.random.default_rng(0), models["Open"])
    assert [head(rule.leaf) for rule in rules] in (["Drive", "Open"], ["Drive(to: door)", "Open"])
    assert words(rules[0].when) == {"place != door"}


PLACES = ("left", "middle", "right")
LAKE = Vocabulary(
    "lake",
    {"Left": Action("goes left"), "Right": Action("goes right")},
    {"place": enumeration("where it is", PLACES)},
)


@pytest.mark.parametrize(
    ("optimistic", "expected"),
    [
        (False, "selector { when place == left { Left } Right }"),
        (True, "selector { when place == right { Right } Left }"),
    ],
)
def test_the_best_policy_of_a_small_world(optimistic: bool, expected: str) -> None:
    """Actions that never fail lead somewhere; what was never tried is explored by optimism."""
    samples = [
        ActionSample("Left", True, (0.0,), (2.0,), 0.0, 9),  # around the lake, nine times of ten
        ActionSample("Left", True, (0.0,), (), 0.0, 1, last=True),
        ActionSample("Right", True, (0.0,), (), 0.0, 10, last=True),  # into the water
        ActionSample("Right", True, (1.0,), (2.0,), 0.0, 5),
        ActionSample("Right", True, (2.0,), (), 1.0, 5, last=True),
        ActionSample("Left", True, (2.0,), (), 0.0, 5),  # another action followed
        ActionSample("Left", True, (2.0,), (1.0,), 0.0, 5),
    ]
    records = recorded({}, samples, LAKE)
    assert best_policy(records, LAKE, optimistic=optimistic) == parse(expected, LAKE)
    assert best_policy(records, VOCABULARY, optimistic=optimistic) is None  # too many keys


@pytest.mark.parametrize(
    ("child", "neutral"),
    [
        ("selector { when place != shelf { Drive } Fetch }", True),
        ("selector { when place == yard { Drive } Open }", False),
    ],
)
def test_a_neutral_child_calls_the_same_actions(child: str, neutral: bool) -> None:
    """On all blackboards on which its mother's actions started."""
    mother = parse("selector { when place == yard { Drive } Fetch }", VOCABULARY)
    observer = ActionObserver(mother, VOCABULARY)
    chain().run_episode(mother, 0, {}, observer)
    screen = Screen(VOCABULARY, {digest(mother): observer.result()})
    assert screen.neutral(parse(child, VOCABULARY), mother) == neutral


def test_the_commands_of_the_page_compose(monkeypatch: pytest.MonkeyPatch) -> None:
    """The pages of the plug-in and of its robots, in their folders."""
    chains = ROOT / "plugins/plans/chains"
    monkeypatch.syspath_prepend(str(chains))
    for page in (chains.parent / "README.md", chains / "README.md"):
        found = re.findall(r"^python -m islandgp (.*)$", page.read_text(encoding="utf-8"), re.M)
        for words in map(str.split, found):
            folder = chains / "conf" if words[0] == "--config-dir" else None
            overrides = [word for word in words if "=" in word]
            assert islandgp.compose(*overrides, config_dir=folder).settings.search.name == "plans"
        assert found


@pytest.mark.parametrize(
    ("setting", "proposed"),
    [
        ("domain=hospital", ["plans"]),
        ("domain=cartpole", ["decision_list", "plans"]),
        ("domain=hospital search=plans", []),
    ],
)
def test_a_run_in_which_nothing_works_proposes_a_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, setting: str, proposed: list[str]
) -> None:
    """Installed searches say for what they are; `decision_list` for keys that are numbers."""
    chains = ROOT / "plugins/plans/chains"
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(chains))
    small = ("gp.population=4", "gp.generations=2", "world.ticks=20", "supervisor=baseline")
    folder = ["--config-dir", str(chains / "conf"), "tracking=off", "evaluator=serial"]
    text = CliRunner().invoke(command, ["run", *folder, *setting.split(), *small]).output
    assert re.findall(r"^Perhaps `search=(\w+)`: ", text, re.M) == proposed, text


def test_what_was_learned_is_printed_and_explained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After the run, in its summary, and by `explain` for the actions of its best tree."""
    folder = tmp_path / "chains"
    shutil.copytree(ROOT / "plugins/plans/chains", folder)
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(str(folder))
    results = islandgp.run(
        *("domain=forklift", "search=plans", "supervisor=baseline", "search.policy.library=0"),
        *("gp.population=8", "gp.generations=5", "world.ticks=60", "name=learned"),
        *("tracking=off", "evaluator=serial", "seed=3"),
        config_dir="conf",
    )
    best = results.path / str(results.runs["run"][0]) / "best.bt"
    learned = RunFolder(best.parent).summary()["learned"]
    raised = next(s for s in learned if s.startswith("RaiseFork "))
    assert raised.startswith("RaiseFork needs nothing; gives fork_high; ")
    options = ["--config-dir", "conf", "--worlds", "2"]
    shown = CliRunner().invoke(command, ["explain", str(best), *options]).output
    (folder / "all.bt").write_text("domain forklift sequence { RaiseFork Store }")
    elsewhere = CliRunner().invoke(command, ["explain", "all.bt", *options]).output
    assert "Learned from the episodes:" in shown
    assert "Learned" not in elsewhere
    assert "Learned from the episodes:" in report(RunFolder(best.parent), [])
