"""Algorithm 1 on a fake evaluator: what every run promises."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node, within
from islandgp.domain import Outcome
from islandgp.evaluation.base import Job
from islandgp.evolution.loop import evolve
from islandgp.gp.plan import MAX_GENERATIONS, Budget
from islandgp.gp.record import RunState, Step, record_values
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import Guidance
from tests.composed import composed_plan
from tests.evolution.fake import Fake
from tests.evolution.runs import Constant, lines, plan, records, run
from tests.goldens import check_golden
from tests.profiles import examples
from tests.samples import outcome

CHARGER = parse("sequence { SeekCharger ExecuteCharge }")


@examples(max_examples=15)
@given(seed=st.integers(0, 2**63 - 1), rate=st.floats(0, 1))
def test_populations_stay_whole(seed: int, rate: float) -> None:
    """Every generation has N individuals, named by slot, and every tree keeps the limits."""
    run_plan = plan()
    for g, record in enumerate(records(run(run_plan, Constant(rate, CHARGER), seed=seed))):
        assert [i.id for i in record.individuals] == [f"{g}.{slot}" for slot in range(12)]
        assert sum(record.origins.values()) == 12
        for i in record.individuals:
            tree = parse(i.tree)
            assert within(tree, run_plan.gp.limits)


def test_forty_one_generations_forty_of_them_supervised() -> None:
    """The paper's counts: 41 evaluated populations, and an answer after all but the last."""
    supervisor = Constant()
    steps = run(composed_plan("supervisor=baseline"), supervisor)
    assert [step.record.snapshot.generation for step in steps] == list(range(41))
    assert [state.now.generation for state in supervisor.states] == list(range(40))
    assert steps[-1].record.guidance is None
    assert steps[-1].state is None
    assert all(step.record.guidance is not None for step in steps[:-1])


def test_same_seed_same_bytes() -> None:
    """A run is a function of its plan, seed, supervisor and outcomes."""
    one, two, other = (list(lines(run(seed=seed))) for seed in (1, 1, 2))
    assert one == two
    assert one[0] != other[0]


class Dying(Fake):
    """Everybody serves humanoids in the first generation, nobody later."""

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        outcomes = super().evaluate(jobs)
        alive = {"interactions": 3.0 if len(self.batches) == 1 else 0.0}
        return [replace(o, counters={**o.counters, **alive}) for o in outcomes]


def test_parents_exist() -> None:
    """Parents belong to the generation before; an ancestor that comes back, to an earlier one."""
    history = records(run(plan("gp.population=30"), evaluator=Dying()))
    assert all(i.parents == () for i in history[0].individuals)
    names = [{i.id for i in record.individuals} for record in history]
    resurrected = []
    for before, record in enumerate(history[1:]):
        for i in record.individuals:
            if i.origin == "resurrected":
                resurrected.append(i)
            else:
                assert set(i.parents) <= names[before]
    assert {i.parents[0] for i in resurrected} <= names[0]
    assert len(resurrected) >= 6, (
        "the humanoid class dies out in generation 1 and comes back six times"
    )


def test_unmutated_elites_keep_their_trees() -> None:
    """At rate 0 an elite's tree is its parent's, and the best is never lost."""
    history = records(run(supervisor=Constant(0.0)))
    trees = {i.id: i.tree for record in history for i in record.individuals}
    for before, record in pairwise(history):
        best = max(before.individuals, key=lambda i: i.fitness)
        first = record.individuals[0]
        assert (first.origin, first.parents, first.tree) == ("elite", (best.id,), best.tree)
        for i in record.individuals:
            assert i.mutation == ""
            if i.origin in ("elite", "behavioural_elite", "resurrected", "copy"):
                assert i.tree == trees[i.parents[0]]


def test_a_rate_never_shifts_other_draws() -> None:
    """Runs that differ in the rate alone differ, in the next generation, by mutations alone."""
    calm, wild = (
        records(run(supervisor=Constant(0.0))),
        records(run(supervisor=Constant(0.5))),
    )
    assert calm[0].individuals == wild[0].individuals
    mutations = 0
    for a, b in zip(calm[1].individuals, wild[1].individuals, strict=True):
        assert (a.id, a.origin, a.parents) == (b.id, b.origin, b.parents)
        assert b.mutation != "" or a == b
        mutations += b.mutation != ""
    assert 0 < mutations < 12


def test_an_injected_tree_never_shifts_other_draws() -> None:
    """Runs that differ in the injected tree differ, in the next generation, in its slot alone."""
    run_plan = plan("supervisor.inject=true")
    without, with_ = (records(run(run_plan, Constant(0.4, tree))) for tree in (None, CHARGER))
    assert without[0].individuals == with_[0].individuals
    pairs = zip(without[1].individuals, with_[1].individuals, strict=True)
    different = [(a.origin, b.origin) for a, b in pairs if a != b]
    assert different == [("random", "injected")]


def test_arms_share_their_worlds() -> None:
    """With any advice, runs of one seed meet the same worlds in each generation."""
    run_plan = plan("gp.reseed_every=generation")
    arms = [
        run(run_plan, s)
        for s in (
            Constant(0.0),
            Constant(0.9, CHARGER),
            Constant(None),
        )
    ]
    worlds = [[record.worlds for record in records(steps)] for steps in arms]
    assert worlds[0] == worlds[1] == worlds[2]
    assert len(set(worlds[0])) == len(worlds[0])


@pytest.mark.parametrize(
    ("when", "changes"),
    [("generation", [1, 2, 3, 4, 5, 6, 7]), ("epoch", [6]), ("never", [])],
)
def test_new_worlds(when: str, changes: list[int]) -> None:
    """Worlds change with each generation, with each epoch (generation 6 begins one), or never."""
    worlds = [record.worlds for record in records(run(plan(f"gp.reseed_every={when}")))]
    assert [g for g in range(1, 8) if worlds[g] != worlds[g - 1]] == changes


def test_one_world_for_all() -> None:
    """By default everybody of a generation meets the same world."""
    evaluator = Fake()
    run(evaluator=evaluator)
    assert [len({job.seed for job in jobs}) for jobs in evaluator.batches] == [1] * 8


def test_separate_worlds_and_several_episodes() -> None:
    """Without a common world each individual has its own; each episode has another seed."""
    evaluator = Fake()
    history = records(run(plan("gp.shared_seed=false", "gp.episodes=3"), evaluator=evaluator))
    for jobs, record in zip(evaluator.batches, history, strict=True):
        assert len(jobs) == 36
        assert tuple(job.seed for job in jobs) == record.worlds
        assert len(set(record.worlds)) == 36
        assert [job.tree for job in jobs] == [i.tree for i in record.individuals for _ in range(3)]
    assert {len(i.endings) for record in history for i in record.individuals} == {3}


def test_several_episodes_in_common_worlds() -> None:
    """Everybody meets the same three worlds, and is worth the mean."""
    evaluator = Fake()
    history = records(run(plan("gp.episodes=3"), evaluator=evaluator))
    jobs, record = evaluator.batches[0], history[0]
    assert [job.seed for job in jobs] == [*record.worlds] * 12
    fitness = [o.fitness for o in Fake().evaluate(jobs[:3])]
    assert record.individuals[0].fitness == pytest.approx(sum(fitness) / 3)


def test_stages_follow_the_curriculum() -> None:
    """Jobs carry the stage of their generation."""
    evaluator = Fake()
    run(composed_plan("supervisor=baseline", "gp.population=4"), evaluator=evaluator)
    stages = [{job.stage for job in jobs} for jobs in evaluator.batches]
    assert stages == [{0}] * 11 + [{1}] * 10 + [{2}] * 10 + [{3}] * 10


def test_champion() -> None:
    """The champion is the fittest individual of all generations so far, the first of equals."""
    steps = run(supervisor=Constant(0.9))
    best = None
    for step in steps:
        for i in step.record.individuals:
            if best is None or i.fitness > best.fitness:
                best = i
        assert step.champion.record == best
        assert step.champion.record.id.startswith(f"{step.champion.generation}.")


def test_rates() -> None:
    """A rate takes effect in the next generation; before the first answer it is the initial one."""
    history = records(run(supervisor=Constant(0.25)))
    assert [record.snapshot.rate for record in history] == [0.4] + [0.25] * 7


def test_no_opinion_on_the_rate() -> None:
    """A supervisor that gives no rate leaves it as it is."""
    assert {record.snapshot.rate for record in records(run(supervisor=Constant(None)))} == {0.4}


def test_adapt_mutation_off() -> None:
    """Without `adapt_mutation` the rate stays, and the record has the wanted rate."""
    history = records(run(plan("supervisor.adapt_mutation=false"), Constant(0.9)))
    assert {record.snapshot.rate for record in history} == {0.4}
    assert {r.guidance.wanted_rate for r in history if r.guidance} == {0.9}


@pytest.mark.parametrize(
    ("overrides", "tree", "refused", "injected"),
    [
        (["supervisor.inject=true"], CHARGER, "", 1),
        (["supervisor.inject=false"], CHARGER, "injection is switched off", 0),
        (["supervisor.inject=true"], None, "", 0),
        (
            [
                "supervisor.inject=true",
                "gp.max_nodes=3",
                "gp.max_depth=2",
                "gp.trees.children=[1,3]",
            ],
            parse("sequence { SeekCharger ExecuteCharge PatrolWaypoint }"),
            "the tree breaks the limits",
            0,
        ),
    ],
)
def test_injection(overrides: list[str], tree: Node | None, refused: str, injected: int) -> None:
    """A tree takes its slot if it may and fits; else the record has the reason."""
    history = records(run(plan(*overrides), Constant(0.0, tree)))
    for before, record in pairwise(history):
        assert before.guidance is not None
        assert before.guidance.refused == refused
        assert before.guidance.injected is bool(injected)
        assert (before.guidance.tree is None) is (tree is None)
        new = [i for i in record.individuals if i.origin == "injected"]
        assert len(new) == injected
        assert all(parse(i.tree) == tree for i in new)


class OneClass(Fake):
    """Everybody is patrol-only: diversity 0."""

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        return [outcome(fitness=1.0) for _ in jobs]


def test_crisis_overrides() -> None:
    """Eq. (7) and (8): in a crisis the emergency rate holds and is recorded, for any wanted one."""
    history = records(run(supervisor=Constant(0.1), evaluator=OneClass()))
    rates = [(r.guidance.wanted_rate, r.guidance.crisis, r.guidance.applied_rate)
            for r in history if r.guidance]  # fmt: skip
    assert rates == [(0.1, "diversity", 0.5)] * 7
    assert [record.snapshot.rate for record in history] == [0.4] + [0.5] * 7


def test_crisis_without_adaptation() -> None:
    """The safeguard belongs to evolution, not to the supervisor: it works without `adapt`."""
    history = records(
        run(plan("supervisor.adapt_mutation=false"), Constant(0.1), evaluator=OneClass())
    )
    assert {record.snapshot.rate for record in history[1:]} == {0.5}


@pytest.mark.parametrize("spared", [True, False])
def test_mutate_elites(spared: bool) -> None:
    """As in the paper mutation hits everybody; `mutate_elites=false` spares elites and injected."""
    run_plan = plan(f"gp.mutate_elites={not spared}".lower(), "supervisor.inject=true")
    hit = {
        i.origin
        for record in records(run(run_plan, Constant(1.0, CHARGER)))
        for i in record.individuals
        if i.mutation
    }
    assert {"elite", "behavioural_elite", "injected"} & hit == (
        set() if spared else {"elite", "behavioural_elite", "injected"}
    )
    assert {"crossover", "copy"} <= hit


class Probe:
    """A supervisor whose rate depends on its own draws."""

    name = "probe"

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """See `Supervisor`."""
        return Guidance(float(rng.random()), None, self.name, reasoning=str(state.best_trend))


def test_resume_from_any_state() -> None:
    """A run that goes on from any of its states ends in the same records as one in one go."""
    run_plan = plan()
    straight = run(run_plan, Probe())
    expected = list(lines(straight))
    for at, step in enumerate(straight[:-1], 1):
        resumed = run(run_plan, Probe(), start=step.state)
        assert list(lines(resumed)) == expected[at:]
        assert resumed[-1].champion == straight[-1].champion


def test_costs() -> None:
    """Costs are counted beside the record."""
    steps = run(plan("gp.episodes=2"))
    assert [step.cost.episodes for step in steps] == [24] * 8
    assert all(min(step.cost.evaluation, step.cost.operators) >= 0 for step in steps)


def test_three_generations_golden() -> None:
    """The records of three generations, against a golden file."""
    text = json.dumps(three_generations(), indent=1)
    check_golden("three_generations.json", text + "\n")


def three_generations() -> list[dict[str, object]]:
    """A small run's records as plain values."""
    run_plan = plan(
        "gp.population=8",
        "gp.generations=3",
        "supervisor.inject=true",
        "gp.trees.kinds.parallel=0.5",
    )
    return [
        record_values(record) for record in records(run(run_plan, Constant(0.5, CHARGER), seed=7))
    ]


class Tries(Constant):
    """Runs seven episodes for each answer."""

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """See `Supervisor`."""
        return replace(super().advise(state, rng), episodes=7)


@pytest.mark.parametrize(
    ("episodes", "line"),
    [(9, "expected at least 10, one "), (10**20, "expected at most 1,000,000, those of 100,000 ")],
)
def test_a_budget_has_one_generation_and_no_more_than_the_greatest_number(
    episodes: int, line: str
) -> None:
    """The message names the key that was set, with the limit."""
    with pytest.raises(ValueError, match=f"^budget.episodes: {line}"):
        Budget(episodes=episodes).generations(8, 1, 0.3)
    assert Budget(episodes=1_000_000).generations(8, 1, 0.3) <= MAX_GENERATIONS


def test_every_episode_counts_in_the_budget() -> None:
    """Those of the supervisor and of its library's search end a run earlier, resumed or not."""
    run_plan = plan("budget.episodes=200", "gp.validation=0")
    assert run_plan.gp.generations == 16
    assert len(run(run_plan)) == 16

    def steps(start: RunState | None = None) -> list[Step]:
        generations = evolve(run_plan, 1, Tries(), Fake(), start=start, library_episodes=50)
        return list(generations)

    straight = steps()
    costs = [step.cost for step in straight]
    assert [cost.episodes for cost in costs] == [12 + 50 + 7, *[12 + 7] * (len(costs) - 2), 12]
    assert [cost.outside_training for cost in costs] == [57, *[7] * (len(costs) - 2), 0]
    assert [cost.library for cost in costs] == [50, *[0] * (len(costs) - 1)]
    total = sum(cost.episodes for cost in costs)
    assert total <= 200 < total + 12 + 7
    rest = steps(straight[2].state)
    assert [step.record for step in rest] == [step.record for step in straight[3:]]
    assert [step.cost.episodes for step in rest] == [cost.episodes for cost in costs[3:]]
