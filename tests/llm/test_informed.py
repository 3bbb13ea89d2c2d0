"""prompts=informed: its facts are right, have a largest size, repeat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from islandgp.bt.core.language import parse
from islandgp.evaluation.base import Problem
from islandgp.evaluation.serial import Serial
from islandgp.evolution.loop import evolve
from islandgp.gp.record import IndividualRecord
from islandgp.records.folder import RunFolder
from islandgp.running.parts import make_supervisor, run_context
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import GenerationView, Guidance, RunContext, Supervisor
from islandgp.supervision.llm.history import most_lacking
from islandgp.supervision.llm.questions import Questions
from tests.composed import composed
from tests.goldens import check_golden
from tests.llm.faults import Fault, every
from tests.llm.samples import settings, state
from tests.llm.server import MessagesServer
from tests.llm.test_prompts import prompt_text
from tests.llm.test_whole_run import lines, live, replayed
from tests.samples import CLASSES

SMALL = ("gp.population=8", "gp.generations=8", "world.episode.length=40")
INFORMED = "supervisor.policy.prompts=informed"


class Keeps:
    """The expert, which stores the generations that it receives."""

    name = "keeps"

    def __init__(self, expert: Supervisor) -> None:
        self.expert = expert
        self.generations: list[GenerationView] = []
        self.states: list[PopulationState] = []

    def on_generation(self, generation: GenerationView) -> None:
        """See `GenerationListener`."""
        self.generations.append(generation)

    def advise(self, at: PopulationState, rng: np.random.Generator) -> Guidance:
        """See `Supervisor`."""
        self.states.append(at)
        return self.expert.advise(at, rng)


@cache
def small_run(*overrides: str) -> tuple[RunContext, Keeps]:
    """A run with real episodes, and the generations that its supervisor got."""
    run_settings = composed("supervisor=expert", *SMALL, *overrides)
    domain = run_settings.make_domain()
    keeps = Keeps(make_supervisor(run_settings, None))
    evaluator = Serial(Problem(domain, run_settings.curriculum))
    list(evolve(run_settings.plan(domain), 5, keeps, evaluator))
    return run_context(composed("supervisor=llm", *SMALL, *overrides)), keeps


def adviser(*overrides: str, run: Sequence[str] = ()) -> Questions:
    """One with informed prompts that has seen the small run with the overrides `run`."""
    context, keeps = small_run(*run)
    questions = Questions(settings("prompts=informed", *overrides), context)
    for generation in keeps.generations:
        questions.on_generation(generation)
    return questions


def test_golden_informed_rate_prompt() -> None:
    """The whole question for a mutation rate, after seven generations of a small run."""
    at = small_run()[1].states[-1]
    prompt = prompt_text(adviser().request("rate", at))
    check_golden("prompt_informed_mutation_rate.md", prompt)


def test_golden_informed_tree_prompt() -> None:
    """The whole question for a tree, traces and fates included."""
    at = small_run()[1].states[-1]
    prompt = prompt_text(adviser().request("tree", at))
    check_golden("prompt_informed_tree_explore.md", prompt)


def test_reasons_come_before_the_decision() -> None:
    """In the schema's order, too: a server that keeps to it writes the fields in that order."""
    at = small_run()[1].states[-1]
    for prompts, first in (("informed", True), ("paper", False)):
        questions = adviser(f"prompts={prompts}")
        rate = questions.request("rate", at).schema
        tree = questions.request("tree", at).schema
        assert rate is not None
        assert tree is not None
        for shape, reason, decision in (
            (rate, "reasoning", "mutation_rate"),
            (tree, "rationale", "tree"),
        ):
            order = list(shape["properties"])
            assert (order.index(reason) < order.index(decision)) is first
            assert shape["required"] == order


def test_before_the_first_generation_nothing_is_known() -> None:
    """The parts that a run fills are left out, and no trace is played."""
    questions = Questions(settings("prompts=informed"), small_run()[0])
    text = prompt_text(questions.request("tree", state()))
    assert "Points of an event" in text
    for part in ("What each class", "The last decisions", "What two trees"):
        assert part not in text
    assert not any(questions.episodes.values())


def test_traces_are_of_the_episode_that_was_scored() -> None:
    """The world and the factors are those of the record, so the points are, too."""
    context, keeps = small_run()
    generation = keeps.generations[-1]
    best = max(generation.individuals, key=lambda i: i.fitness)
    text = adviser().request("tree", keeps.states[-1]).turns[0]
    assert f"The fittest tree, {best.fitness:,.0f} points" in text
    outcome = context.domain.run_episode(
        parse(best.tree), generation.worlds[0], generation.multipliers
    )
    assert outcome.fitness == best.fitness


def test_prompts_have_a_largest_size() -> None:
    """The largest trees, the longest histories: not more than the documented characters."""
    context, keeps = small_run()
    huge = "sequence { " + "PatrolWaypoint " * 49 + "}\n"
    questions = Questions(settings("prompts=informed"), context)
    for _ in range(5):
        for generation in keeps.generations:
            trees = tuple(
                replace(i, tree=huge, origin="injected", fitness=-123456789.0)
                for i in generation.individuals
            )
            questions.on_generation(replace(generation, individuals=trees))
    at = keeps.states[-1]
    plain = Questions(settings(), context)
    for part in ("rate", "tree"):
        question, short = (of.request(part, at).turns[0] for of in (questions, plain))
        assert len(question) - len(short) < 30_000


@pytest.mark.slow
def test_runs_repeat_and_go_on(tmp_path: Path) -> None:
    """Live, replayed, and stopped and gone on: the same bytes, also with faults."""
    common = ("gp.generations=6", "world.episode.length=20")
    overrides = (*common, INFORMED)
    with MessagesServer(every(4, [Fault.UNKNOWN_ACTION, Fault.HTML])) as server:
        steps = live(server, tmp_path / "live", *overrides)
    assert lines(replayed(tmp_path / "live", tmp_path / "again", *common)) == lines(steps)
    assert sum(step.cost.outside_training for step in steps) >= 6 - 1
    with MessagesServer() as server:
        whole_run = live(server, tmp_path / "whole", *overrides)
        first = live(server, tmp_path / "parts", *overrides, stop=2)
        past = [step.record for step in first]
        rest = live(server, tmp_path / "parts", *overrides, start=first[-1].state, past=past)
    assert lines([*first, *rest]) == lines(whole_run)


def individual(
    at: str, fitness: float, *parents: str, origin: str = "crossover"
) -> IndividualRecord:
    """A line of a made-up lineage; each tree is its id."""
    one = small_run()[1].generations[0].individuals[0]
    return replace(one, id=at, fitness=fitness, parents=parents, origin=origin, tree=f"{at}\n")


def test_a_decision_has_its_tree_with_points_and_rank() -> None:
    """Of the generation in which the tree was evaluated first; an unchanged one is shown once."""
    _, keeps = small_run()
    text = adviser().request("tree", keeps.states[-1]).turns[0]
    view = [v for v in keeps.generations if v.guidance and v.guidance.injected][-1]
    new = next(i for i in view.individuals if i.origin == "injected")
    rank = 1 + sum(i.fitness > new.fitness for i in view.individuals)
    assert f" points, rank {rank} of {len(view.individuals)}" in text
    assert f"for generation {view.snapshot.generation} by expert:" in text


def test_the_most_lacking_shows_the_fewest_behaviours() -> None:
    """Of equals it is the least fit."""
    one = individual("0.0", 5)
    nothing = dict.fromkeys(one.counters, 0.0)
    people = [
        replace(one, id="a", fitness=1, counters={**nothing, "pickups": 1.0}),
        replace(one, id="b", fitness=9, counters=nothing),
        replace(one, id="c", fitness=2, counters=nothing),
    ]
    assert most_lacking(people, CLASSES).id == "c"


def test_records_are_read_as_they_were_made(tmp_path: Path) -> None:
    """A resumed run gives its supervisor the same generations as the loop."""
    folder = RunFolder(tmp_path)
    with MessagesServer() as server:
        steps = live(server, tmp_path, "gp.generations=3", "world.episode.length=20")
    for step in steps:
        folder.append(step)
    assert list(folder.generations()) == [step.record for step in steps]
