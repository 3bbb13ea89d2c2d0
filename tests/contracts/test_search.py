"""What every search guarantees, for any outcomes: each of `conf/search`, and a user's.

A search of yours is checked in the same way: add it to SEARCHES below.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node, leaf, within
from islandgp.bt.core.vocabulary import Action, Vocabulary, flag
from islandgp.config.settings import Settings
from islandgp.errors import ConfigError
from islandgp.evolution.loop import evolve
from islandgp.gp.edits import Edit
from islandgp.gp.plan import Plan
from islandgp.gp.record import RunState, Step
from islandgp.plain import to_json
from islandgp.plugin import imported
from islandgp.records.checkpoint import read_checkpoint, save_state
from islandgp.resources import resource
from islandgp.running.parts import make_search, plan_of
from islandgp.scoring.constraints import violation
from islandgp.search.base import USES, Search, SearchContext
from islandgp.supervision.base import GenerationView, Supervisor
from tests.composed import composed
from tests.evolution.fake import Fake
from tests.evolution.runs import Constant, lines
from tests.profiles import sweep
from tests.search.searches import NAMES

SMALL = ("supervisor=expert", "gp.population=12", "gp.generations=7")
FEWER = (
    "compose",
    "decision_list",
)  # searches that may ask for fewer than gp.population individuals
REFUSED = {  # by search: the start of a word of configuration, and what it is answered
    "compose": {
        "gp.max_nodes=": "expected branches that fit",
        "gp.founders=": "expected only the library's branches",
    },
    "decision_list": {
        "gp.max_nodes=": "expected a list of all actions within gp.max_nodes",
        "gp.founders=": "expected no trees that open the population",
    },
}
CHARGER = parse("sequence { SeekCharger ExecuteCharge }")
GUARDED = parse("when batteryLevel < 30 abort lower { sequence { SeekCharger ExecuteCharge } }")

WAITING = Vocabulary("waiting", {"Wait": Action("waits")}, {})
BLIND = Vocabulary("blind", {"Left": Action("turns left"), "Right": Action("turns right")}, {})
LONELY = Vocabulary("lonely", {"Wait": Action("waits")}, {"warm": flag("it is warm")})


@dataclass(frozen=True)
class Case:
    """A search that configuration chooses."""

    name: str

    def settings(self, *overrides: str) -> Settings:
        """The settings of a small run with it."""
        return composed(*SMALL, f"search={self.name}", *overrides)

    def run(
        self,
        *overrides: str,
        seed: int = 1,
        supervisor: Supervisor | None = None,
        start: RunState | None = None,
    ) -> list[Step]:
        """All steps of a run whose outcomes are the fake's."""
        settings = self.settings(*overrides)
        plan = plan_of(settings, settings.make_domain())
        search = make_search(settings, plan)
        return run(plan, search, seed=seed, supervisor=supervisor, start=start)


def run(
    plan: Plan,
    search: Search,
    *,
    seed: int = 1,
    supervisor: Supervisor | None = None,
    start: RunState | None = None,
) -> list[Step]:
    """All steps of a run whose outcomes are the fake's."""
    supervisor = supervisor or Constant(0.3)
    return list(evolve(plan, seed, supervisor, Fake(), search=search, start=start))


SEARCHES = [Case(name) for name in (*NAMES, "decision_list", "plans")]
QUICK = ("compose", "paper", "racing")  # of different families; the others have separate tests


@pytest.fixture(
    params=[
        pytest.param(case, id=case.name, marks=() if case.name in QUICK else pytest.mark.slow)
        for case in SEARCHES
    ]
)
def case(request: pytest.FixtureRequest) -> Case:
    """Each search in turn."""
    search_case: Case = request.param
    return search_case


@cache
def straight(case: Case) -> list[Step]:
    """A run in one go, in which a tree is injected and dropped again."""
    return case.run("supervisor.inject=true", supervisor=Sometimes())


class Sometimes(Constant):
    """Gives a tree after every second generation."""

    def advise(self, state: Any, rng: Any) -> Any:
        """See `Supervisor`."""
        guidance = super().advise(state, rng)
        return replace(guidance, tree=CHARGER if state.now.generation % 2 else None)


def test_the_suite_has_all_searches() -> None:
    """A file in conf/search is checked here; names are as their files are called."""
    assert len(SEARCHES) >= 9
    for name in NAMES:
        option = yaml.safe_load((resource("conf") / f"search/{name}.yaml").read_text())["search"]
        assert option["name"] == name
        assert imported(option["factory"]).uses <= USES


def test_the_same_seed_gives_the_same_records(case: Case) -> None:
    """And another seed gives others."""
    repeated = case.run("supervisor.inject=true", supervisor=Sometimes())
    other = case.run("supervisor.inject=true", supervisor=Sometimes(), seed=2)
    assert list(lines(repeated)) == list(lines(straight(case)))
    assert [i.tree for i in other[0].record.individuals] != [
        i.tree for i in repeated[0].record.individuals
    ]


def test_resuming_changes_nothing(case: Case, tmp_path: Path) -> None:
    """From the state after every second generation, through a checkpoint, the rest is the same."""
    steps = straight(case)
    expected = list(lines(steps))
    for step in steps[:-1:2]:
        assert step.state is not None
        save_state(tmp_path / "checkpoint.json", step.state)
        checkpoint, _ = read_checkpoint(tmp_path / "checkpoint.json")
        start = replace(checkpoint, history=step.state.history)
        rest = case.run("supervisor.inject=true", supervisor=Sometimes(), start=start)
        assert list(lines(rest)) == expected[start.generation :]


RESTARTS = (
    "search.policy.random_generations=1",
    "search.policy.restarts=2",
    "search.policy.joint=0.2",
)
"""Restarts of three generations each, then a joint one."""


def test_resuming_between_restarts_changes_nothing(tmp_path: Path) -> None:
    """The champions of earlier restarts are in the checkpoint."""
    racing = Case("racing")
    steps = racing.run(*RESTARTS)
    for step in steps[:-1]:
        assert step.state is not None
        save_state(tmp_path / "checkpoint.json", step.state)
        state, _ = read_checkpoint(tmp_path / "checkpoint.json")
        start = replace(state, history=step.state.history)
        rest = racing.run(*RESTARTS, start=start)
        assert list(lines(rest)) == list(lines(steps))[start.generation :]


def test_the_memory_is_plain(case: Case) -> None:
    """It is JSON, and does not grow without bound: less than 4 kB an individual."""
    steps = case.run("gp.generations=12")
    for step in steps[:-1]:
        assert step.state is not None
        memory = step.state.memory
        kind = case.settings().search.factory.Memory
        assert memory is None or isinstance(memory, kind)
    last = steps[-2].state
    assert last is not None
    assert len(json.dumps(to_json(last.memory), allow_nan=False)) < 12 * 12 * 4000


TREES = sweep(
    "overrides",
    [
        ("gp.population=4", "gp.max_depth=2", "gp.max_nodes=3", "gp.trees.children=[1,3]"),
        ("gp.founders=true",),
        (),
        ("supervisor.inject=true",),
        ("gp.max_depth=50", "gp.max_nodes=5"),
    ],
    quick=3,
    ids=" ".join,
)


@TREES
def test_populations(case: Case, overrides: tuple[str, ...]) -> None:
    """Ids, sizes, limits and words; also with few slots, tight limits, founders and late answers.

    A search that cannot work there raises an error before the run begins.
    """
    settings = case.settings("gp.generations=5", *overrides)
    plan = plan_of(settings, settings.make_domain())
    for start, answer in REFUSED.get(case.name, {}).items():
        if any(word.startswith(start) for word in overrides):
            with pytest.raises(ConfigError, match=f"^search={case.name}: {answer}"):
                make_search(settings, plan)
            return
    search = make_search(settings, plan)
    steps = run(plan, search, supervisor=Constant(0.3, CHARGER))
    assert len(steps) == 5
    check(steps, plan, case.name in FEWER)
    if "gp.founders=true" in overrides:
        assert steps[0].record.origins["injected"] >= len(plan.founders) > 0


def check(steps: list[Step], plan: Plan, fewer: bool = False) -> None:
    """What holds for the individuals of every run."""
    earlier: set[str] = set()
    for g, step in enumerate(steps):
        individuals = step.record.individuals
        n = plan.gp.population
        assert 1 <= len(individuals) <= n
        assert fewer or len(individuals) == n
        assert [i.id for i in individuals] == [f"{g}.{slot}" for slot in range(len(individuals))]
        for i in individuals:
            assert set(i.parents) <= earlier
            assert within(parse(i.tree, plan.vocabulary), plan.gp.limits)
        earlier |= {i.id for i in individuals}


@sweep("vocabulary", [LONELY, BLIND, WAITING], quick=1, ids=lambda vocabulary: vocabulary.domain)
@sweep("overrides", [("gp.population=4", "gp.max_depth=2", "gp.max_nodes=3"), ()], quick=1)
def test_small_vocabularies(case: Case, vocabulary: Vocabulary, overrides: tuple[str, ...]) -> None:
    """One action, no keys: there may be no new tree, but there is always a population."""
    children = ("gp.trees.children=[1,3]",)
    settings = case.settings("library=automatic", *children, *overrides)
    plan = replace(settings.plan(settings.make_domain()), vocabulary=vocabulary)

    def library() -> Mapping[str, Node]:
        return {name: leaf(name) for name in vocabulary.actions}

    part = settings.search
    if case.name == "decision_list":
        with pytest.raises(ConfigError, match="expected 1 to 40 keys that are numbers, found 0"):
            part.factory.make(part.settings(), SearchContext(plan, library))
        return
    search = part.factory.make(part.settings(), SearchContext(plan, library))
    steps = run(plan, search)
    assert len(steps) == 7
    check(steps, plan, case.name in FEWER)


def test_advice_is_obeyed_or_refused(case: Case) -> None:
    """A tree is in the next generation and a rate applies to it, or the record has the reason."""
    uses = case.settings().search.factory.uses
    steps = case.run("supervisor.inject=true", supervisor=Constant(0.9, CHARGER))
    for before, after in itertools.pairwise(steps):
        guidance = before.record.guidance
        assert guidance is not None
        injected = [i for i in after.record.individuals if i.origin == "injected"]
        assert guidance.injected is ("tree" in uses)
        assert len(injected) == int(guidance.injected)
        assert all(parse(i.tree) == CHARGER for i in injected if not i.mutation)
        assert ("no mutation rate" in guidance.refused) is ("rate" not in uses)
        assert ("takes no trees" in guidance.refused) is ("tree" not in uses)
        if "rate" in uses:
            assert after.record.snapshot.rate == 0.9


class Edits(Constant):
    """Edits the first individuals of each generation, and injects a tree."""

    current: GenerationView | None = None

    def on_generation(self, generation: GenerationView) -> None:
        """See `GenerationListener`."""
        self.current = generation

    def advise(self, state: Any, rng: Any) -> Any:
        """See `Supervisor`."""
        guidance = super().advise(state, rng)
        assert self.current is not None
        edits = (
            Edit("front", of=i.id, branch=GUARDED, reason="charge")
            for i in self.current.individuals
        )
        return replace(guidance, edits=tuple(edits))


@sweep(
    "overrides",
    [
        ("+supervisor.edits=9", "supervisor.inject=true"),
        ("+supervisor.edits=1", "gp.population=4"),
        ("+supervisor.edits=3",),
    ],
    quick=2,
    ids=" ".join,
)
def test_edits_are_obeyed_or_refused(case: Case, overrides: tuple[str, ...]) -> None:
    """An edited tree is in the next generation, with its parent, or the record has the reason.

    There are as many as there are slots, where enough edits can be made.
    """
    settings = case.settings("gp.generations=5", *overrides)
    plan = plan_of(settings, settings.make_domain())
    takes = "edits" in settings.search.factory.uses
    steps = run(plan, make_search(settings, plan), supervisor=Edits(1.0, CHARGER))
    check(steps, plan, case.name in FEWER)
    count = 0
    for before, after in itertools.pairwise(steps):
        guidance = before.record.guidance
        assert guidance is not None
        accepted = [edit for edit in guidance.edits if not edit.refused]
        edited = [i for i in after.record.individuals if i.origin == "edited"]
        assert [(i.parents[0], i.mutation) for i in edited] == [
            (e.of, "edit:front") for e in accepted
        ]
        assert all(
            parse(i.tree) != parse(edit.branch or "")
            for i, edit in zip(edited, accepted, strict=True)
        )
        assert len(edited) <= plan.switches.edits
        assert all(edit.refused == "the search takes no edits" for edit in guidance.edits) or takes
        assert [trial.id for trial in after.record.trials] == [i.id for i in edited]
        count += len(edited)
    assert (count > 0) is takes


def test_resuming_with_edits_changes_nothing(case: Case, tmp_path: Path) -> None:
    """From an early and a late state, through a checkpoint, the rest is the same."""
    overrides = ("+supervisor.edits=2",)
    steps = case.run(*overrides, supervisor=Edits())
    expected = list(lines(steps))
    for step in steps[1:5:2]:
        assert step.state is not None
        save_state(tmp_path / "checkpoint.json", step.state)
        checkpoint, _ = read_checkpoint(tmp_path / "checkpoint.json")
        start = replace(checkpoint, history=step.state.history)
        rest = case.run(*overrides, supervisor=Edits(), start=start)
        assert list(lines(rest)) == expected[start.generation :]


def test_a_tree_is_injected_once(case: Case) -> None:
    """Advice holds for the next generation, and not for those after it."""
    steps = straight(case)
    for before, after in itertools.pairwise(steps):
        guidance = before.record.guidance
        assert guidance is not None
        injected = [i for i in after.record.individuals if i.origin == "injected"]
        assert len(injected) == int(guidance.injected)


LIMITED = ("constraints={pickups: {at_most: 0}, distance: {at_most: 1500}}",)
"""About a sixth of the fake's outcomes keep these."""


@cache
def limited(case: Case) -> list[Step]:
    """A run with constraints, under which fit individuals mostly break one."""
    return case.run(*LIMITED)


def broken(case: Case, counters: Mapping[str, float]) -> float:
    """The violation of counters."""
    return violation(counters, case.settings(*LIMITED).constraints)


def test_the_champion_is_feasible_before_fit(case: Case) -> None:
    """It is the best of all individuals by Deb's rules."""
    steps = limited(case)
    everyone = [i for step in steps for i in step.record.individuals]
    ranking = {i.id: (-broken(case, i.counters), i.fitness) for i in everyone}
    best = max(everyone, key=lambda i: ranking[i.id])
    assert ranking[steps[-1].champion.record.id] == ranking[best.id]


@pytest.mark.slow
def test_feasible_comes_before_fit(case: Case) -> None:
    """With constraints fewer individuals of the end break a limit.

    Random search draws its trees from the same distribution all along.
    """
    if case.name in FEWER or case.name.startswith("random"):
        return
    free, bound = (
        sum(
            not broken(case, i.counters)
            for seed in range(1, 5)
            for step in case.run(*overrides, seed=seed)[4:]
            for i in step.record.individuals
        )
        for overrides in ((), LIMITED)
    )
    assert bound > free


def test_resuming_with_constraints_changes_nothing(case: Case, tmp_path: Path) -> None:
    """What a search remembers of the limited counters is in its checkpoint."""
    steps = limited(case)
    for step in steps[1:5:2]:
        assert step.state is not None
        save_state(tmp_path / "checkpoint.json", step.state)
        checkpoint, _ = read_checkpoint(tmp_path / "checkpoint.json")
        start = replace(checkpoint, history=step.state.history)
        rest = case.run(*LIMITED, start=start)
        assert list(lines(rest)) == list(lines(steps))[start.generation :]


def test_a_run_of_one_generation(case: Case) -> None:
    """It ends without asking the search for another one."""
    (step,) = case.run("gp.generations=1")
    assert step.state is None
    assert step.record.guidance is None
