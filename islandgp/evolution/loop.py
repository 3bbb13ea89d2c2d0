"""Algorithm 1: supervised genetic programming, as a generator of generations.

It reads no file and writes none. Each step is a function of the run's state, so
a run can go on from any of its states and ends in the same bytes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Sequence
from dataclasses import replace
from time import perf_counter

from islandgp.bt.language import to_text
from islandgp.bt.limits import within
from islandgp.bt.node import Node, depth, size
from islandgp.evaluation.base import Evaluator, Job
from islandgp.evolution.allocation import next_population, remember
from islandgp.evolution.generation import random_tree
from islandgp.evolution.plan import Plan
from islandgp.evolution.population import Evaluated, Individual, Origin
from islandgp.evolution.record import (
    Champion,
    Cost,
    GenerationRecord,
    GuidanceRecord,
    IndividualRecord,
    RunState,
    Step,
)
from islandgp.evolution.variation import mutate
from islandgp.scoring.classify import specialist, tiers
from islandgp.scoring.outcome import combine
from islandgp.scoring.state import PopulationState, Snapshot, behaviours, measure, population_state
from islandgp.seeding import Stream, stream, world_seed
from islandgp.supervision.base import Guidance, Supervisor
from islandgp.supervision.crisis import applied_rate, crisis_reason
from islandgp.supervision.lag import Desk


def initial_state(plan: Plan, seed: int) -> RunState:
    """Line 1 and 2 of Algorithm 1: random trees and the initial mutation rate."""
    gp = plan.gp
    population = tuple(
        Individual(
            f"0.{slot}",
            random_tree(stream(seed, Stream.INITIAL, slot=slot), gp.trees, gp.limits),
            Origin.RANDOM,
        )
        for slot in range(gp.population)
    )
    return RunState(0, population, gp.mutation_rate, (), {}, None)


def evolve(
    plan: Plan,
    seed: int,
    supervisor: Supervisor,
    evaluator: Evaluator,
    *,
    start: RunState | None = None,
) -> Generator[Step, None, None]:
    """Algorithm 1 from `start` (default: from generation 0) to the last generation."""
    state = initial_state(plan, seed) if start is None else start
    desk = Desk(supervisor, seed=seed, lag=plan.switches.lag)
    try:
        for generation in range(max(0, state.generation - plan.switches.lag), state.generation):
            desk.ask(_view(plan, state.history[: generation + 1]))
        while True:
            step = _generation(plan, seed, state, desk, evaluator)
            yield step
            if step.state is None:
                return
            state = step.state
    finally:
        desk.close()


def _generation(plan: Plan, seed: int, state: RunState, desk: Desk, evaluator: Evaluator) -> Step:
    """Lines 4 to 15 of Algorithm 1."""
    began, simulated = perf_counter(), evaluator.simulated
    g = state.generation
    worlds = _worlds(plan, seed, g)
    texts = [to_text(i.tree) for i in state.population]
    before = perf_counter()
    population = _evaluate(plan, state, texts, worlds, evaluator)
    evaluation = perf_counter() - before
    snapshot = _measure(plan, state, population)
    history = (*state.history, snapshot)
    archive = remember(state.archive, population)
    lines = tuple(_line(e, text) for e, text in zip(population, texts, strict=True))
    champion = _champion(state.champion, g, lines)
    view = _view(plan, history)
    following: RunState | None = None
    guidance: GuidanceRecord | None = None
    waited = 0.0
    if g + 1 < plan.gp.generations:
        before = perf_counter()
        if g + plan.switches.lag + 1 < plan.gp.generations:  # else nobody waits for the answer
            desk.ask(view)
        answer = desk.answer(g)
        waited = perf_counter() - before
        guidance, tree = _decide(plan, view, answer, state.rate)
        children = next_population(
            population,
            seed=seed,
            generation=g + 1,
            injected=tree,
            archive=archive,
            diversity=snapshot.diversity,
            allocation=plan.allocation,
            trees=plan.gp.trees,
            limits=plan.gp.limits,
            crossover_rate=plan.gp.crossover_rate,
            tournament_size=plan.gp.tournament,
        )
        rate = guidance.applied_rate
        mutated = _mutate_all(plan, seed, g + 1, children, rate)
        following = RunState(g + 1, mutated, rate, history, archive, champion)
    record = GenerationRecord(
        snapshot=snapshot,
        worlds=worlds,
        origins=dict(Counter(i.origin.value for i in state.population)),
        stagnant_generations=view.stagnant_generations,
        individuals=lines,
        guidance=guidance,
    )
    cost = Cost(
        evaluation=evaluation,
        supervision=waited,
        operators=perf_counter() - began - evaluation - waited,
        episodes=len(population) * plan.gp.episodes,
        simulated=evaluator.simulated - simulated,
        llm=desk.spent(),
    )
    return Step(record, following, champion, cost)


def _worlds(plan: Plan, seed: int, generation: int) -> tuple[int, ...]:
    """World seeds of a generation: one an episode, or one an individual and episode."""
    since = {"generation": generation, "epoch": plan.curriculum.epoch(generation), "never": 0}
    n = plan.gp.episodes * (1 if plan.gp.common_world else plan.gp.population)
    day = since[plan.gp.new_worlds]
    return tuple(world_seed(seed, generation=day, episode=i) for i in range(n))


def _evaluate(
    plan: Plan, state: RunState, texts: Sequence[str], worlds: Sequence[int], evaluator: Evaluator
) -> tuple[Evaluated, ...]:
    """Line 4: every individual in its episodes."""
    n, stage = plan.gp.episodes, plan.curriculum.stage(state.generation)
    jobs = [
        Job(text, stage, worlds[e if plan.gp.common_world else i * n + e])
        for i, text in enumerate(texts)
        for e in range(n)
    ]
    outcomes = evaluator.evaluate(jobs)
    found = [combine(outcomes[i : i + n]) for i in range(0, len(outcomes), n)]
    return tuple(
        Evaluated(
            i, o, specialist(o, plan.classes), tiers(o, plan.classes), behaviours(o, plan.classes)
        )
        for i, o in zip(state.population, found, strict=True)
    )


def _measure(plan: Plan, state: RunState, population: Sequence[Evaluated]) -> Snapshot:
    """Line 5: the generation in numbers."""
    return measure(
        [e.outcome for e in population],
        [size(e.individual.tree) for e in population],
        plan.classes,
        generation=state.generation,
        epoch=plan.curriculum.epoch(state.generation),
        stage=plan.curriculum.stage(state.generation),
        rate=state.rate,
    )


def _view(plan: Plan, history: Sequence[Snapshot]) -> PopulationState:
    """Line 6: Table 5, after the last generation of `history`."""
    stage = plan.curriculum.stage(history[-1].generation + 1)
    return population_state(
        history,
        plan.gp.state,
        crossover_rate=plan.gp.crossover_rate,
        population=plan.gp.population,
        generations=plan.gp.generations,
        generations_per_epoch=plan.curriculum.generations_per_epoch,
        multipliers=plan.curriculum.multipliers(stage).model_dump(),
    )


def _decide(
    plan: Plan, view: PopulationState, answer: Guidance | None, rate: float
) -> tuple[GuidanceRecord, Node | None]:
    """Lines 7 to 12: what is done with an answer, and the tree that goes into the population."""
    given = answer or Guidance(None, None, "none", reasoning="no answer is due yet")
    wanted = given.mutation_rate if plan.switches.adapt_mutation else None
    # An emergency does not outlast its crisis where nobody adapts the rate.
    held = rate if plan.switches.adapt_mutation else plan.gp.mutation_rate
    reason = crisis_reason(view, plan.gp.crisis)
    refused = ""
    if given.tree is not None:
        if not plan.switches.inject:
            refused = "injection is switched off"
        elif not within(given.tree, plan.gp.limits):
            refused = "the tree breaks the limits"
    tree = None if refused else given.tree
    record = GuidanceRecord(
        asked_at=None if answer is None else view.now.generation - plan.switches.lag,
        source=given.source,
        phase=given.phase,
        pattern=given.pattern,
        target=given.target,
        intervention=given.intervention,
        wanted_rate=given.mutation_rate,
        crisis=reason,
        applied_rate=applied_rate(held if wanted is None else wanted, reason, plan.gp.crisis),
        tree=None if given.tree is None else to_text(given.tree),
        injected=tree is not None,
        refused=refused,
        risk=given.risk,
        reasoning=given.reasoning,
        rationale=given.rationale,
        notes=given.notes,
    )
    return record, tree


def _mutate_all(
    plan: Plan, seed: int, generation: int, children: Sequence[Individual], rate: float
) -> tuple[Individual, ...]:
    """Line 15: mutation after construction; with `mutate_elites` it spares nobody."""
    kept = (
        () if plan.gp.mutate_elites else (Origin.ELITE, Origin.BEHAVIOURAL_ELITE, Origin.INJECTED)
    )
    return tuple(
        child if child.origin in kept else _mutated(plan, seed, generation, slot, child, rate)
        for slot, child in enumerate(children)
    )


def _mutated(
    plan: Plan, seed: int, generation: int, slot: int, child: Individual, rate: float
) -> Individual:
    tree, operator = mutate(
        stream(seed, Stream.MUTATION, generation=generation, slot=slot),
        child.tree,
        rate=rate,
        trees=plan.gp.trees,
        how=plan.gp.mutation,
        limits=plan.gp.limits,
    )
    return replace(child, tree=tree, mutation=operator) if operator else child


def _line(e: Evaluated, text: str) -> IndividualRecord:
    i, o = e.individual, e.outcome
    return IndividualRecord(
        id=i.id,
        origin=i.origin,
        parents=i.parents,
        mutation=i.mutation,
        tree=text,
        nodes=size(i.tree),
        depth=depth(i.tree),
        fitness=o.fitness,
        components=o.components,
        specialist=e.specialist,
        tiers=e.tiers,
        pickups=o.pickups,
        interactions=o.interactions,
        deliveries=o.deliveries,
        charges=o.charges,
        gathered=o.gathered,
        endings=o.endings,
    )


def _champion(
    before: Champion | None, generation: int, lines: Sequence[IndividualRecord]
) -> Champion:
    best = max(lines, key=lambda line: line.fitness)
    if before is not None and before.record.fitness >= best.fitness:
        return before
    return Champion(generation, best)
