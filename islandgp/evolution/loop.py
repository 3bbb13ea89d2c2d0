"""Algorithm 1: supervised genetic programming, as a generator of generations (section 2.4.3).

It reads no file and writes none. Each step is a function of the run's state, so
a run can go on from any of its states and ends in the same bytes.

Lines 4 to 6 of the algorithm come first: episodes, a generation in numbers, and what
supervisors see.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Iterable, Sequence
from dataclasses import replace
from time import perf_counter
from typing import Final

from islandgp.bt.language import to_text
from islandgp.bt.node import Node, size, within
from islandgp.domain import Outcome, total
from islandgp.evaluation.base import Evaluator, Job
from islandgp.evolution.allocation import next_population, remember
from islandgp.evolution.plan import Plan
from islandgp.evolution.population import Evaluated, Individual, Origin
from islandgp.evolution.random_trees import random_tree
from islandgp.evolution.record import (
    Cost,
    GenerationRecord,
    GuidanceRecord,
    RunState,
    Step,
    fittest,
    line,
)
from islandgp.evolution.variation import mutate
from islandgp.scoring.classes import judge
from islandgp.scoring.snapshot import Snapshot, measure
from islandgp.scoring.state import PopulationState, population_state
from islandgp.seeding import Stream, seed_of, stream
from islandgp.supervision.asking import SupervisorQueue
from islandgp.supervision.base import Guidance, Seen, Supervisor

SPARED: Final = (Origin.ELITE, Origin.BEHAVIOURAL_ELITE, Origin.INJECTED)
"""Individuals that mutation leaves alone where `gp.mutate_elites` is false."""


def worlds_of(plan: Plan, seed: int, generation: int) -> tuple[int, ...]:
    """World seeds of a generation: one an episode, or one an individual and episode."""
    since = {"generation": generation, "epoch": plan.curriculum.epoch(generation), "never": 0}
    n = plan.gp.episodes * (1 if plan.gp.common_world else plan.gp.population)
    day = since[plan.gp.new_worlds]
    return tuple(seed_of(seed, Stream.WORLD, generation=day, slot=i) for i in range(n))


def evaluate(
    plan: Plan,
    generation: int,
    population: Sequence[Individual],
    texts: Sequence[str],
    worlds: Sequence[int],
    evaluator: Evaluator,
) -> tuple[Evaluated, ...]:
    """The individuals, whose canonical texts are `texts`, with what they achieve in the worlds."""
    n, stage = plan.gp.episodes, plan.curriculum.stage(generation)
    jobs = [
        Job(text, stage, worlds[e if plan.gp.common_world else i * n + e])
        for i, text in enumerate(texts)
        for e in range(n)
    ]
    outcomes = evaluator.evaluate(jobs)
    found = [combine(outcomes[i : i + n]) for i in range(0, len(outcomes), n)]
    return tuple(
        Evaluated(i, o, judge(o, plan.classes), o.fitness)
        for i, o in zip(population, found, strict=True)
    )


def combine(outcomes: Sequence[Outcome]) -> Outcome:
    """The mean of several episodes, number by number; one episode's outcome is itself."""
    if len(outcomes) == 1:
        return outcomes[0]
    first, n = outcomes[0], len(outcomes)
    return Outcome(
        components={c: total(o.components[c] for o in outcomes) / n for c in first.components},
        counters={c: total(o.counters[c] for o in outcomes) / n for c in first.counters},
        seconds=total(o.seconds for o in outcomes) / n,
        endings=tuple(ending for o in outcomes for ending in o.endings),
    )


def view(plan: Plan, history: Sequence[Snapshot]) -> PopulationState:
    """Line 6: Table 5, after the last generation of `history`."""
    stage = plan.curriculum.stage(history[-1].generation + 1)
    return population_state(
        history,
        plan.gp.state,
        plan.gp.crisis,
        plan.classes,
        crossover_rate=plan.gp.crossover_rate,
        population=plan.gp.population,
        generations=plan.gp.generations,
        generations_per_epoch=plan.curriculum.generations_per_epoch,
        multipliers=dict(plan.curriculum.multipliers(stage)),
    )


def initial_state(plan: Plan, seed: int) -> RunState:
    """Lines 1 and 2 of Algorithm 1: random trees and the initial mutation rate.

    The plan's founders take the first slots.
    """
    gp, space, founders = plan.gp, plan.space, plan.founders[: plan.gp.population]
    given = [Individual(f"0.{k}", tree, Origin.INJECTED) for k, tree in enumerate(founders)]
    random = [
        Individual(
            f"0.{slot}",
            random_tree(stream(seed, Stream.INITIAL, slot=slot), space),
            Origin.RANDOM,
        )
        for slot in range(len(founders), gp.population)
    ]
    population = (*given, *random)
    return RunState(0, population, gp.mutation_rate, (), {}, None)


def evolve(
    plan: Plan,
    seed: int,
    supervisor: Supervisor,
    evaluator: Evaluator,
    *,
    start: RunState | None = None,
    past: Iterable[GenerationRecord] = (),
) -> Generator[Step, None, None]:
    """Algorithm 1 from `start` (default: from generation 0) to the last generation.

    `past` are the records of the generations before `start`, from 0 on; a supervisor that goes
    by the state alone needs none of them.
    """
    start = initial_state(plan, seed) if start is None else start
    lag = plan.switches.lag
    queue = SupervisorQueue(supervisor, seed=seed, lag=lag, vocabulary=plan.vocabulary)
    try:
        records, led = iter(past), None
        for g in range(start.generation):
            seen, led = _seen(plan, next(records, None), led)
            if g >= start.generation - lag:
                queue.ask(view(plan, start.history[: g + 1]), seen)
            elif seen is not None:
                queue.recall(seen)
        state: RunState | None = start
        while state is not None:
            step = _generation(plan, seed, state, queue, evaluator, led)
            yield step
            state, led = step.state, step.record.guidance
    finally:
        queue.close()


def _seen(
    plan: Plan, record: GenerationRecord | None, led: GuidanceRecord | None
) -> tuple[Seen | None, GuidanceRecord | None]:
    """What a supervisor is told of a record, and the guidance for the generation after it."""
    if record is None:
        return None, None
    now = record.snapshot
    multipliers = plan.curriculum.multipliers(now.stage)
    seen = Seen(now, record.worlds, multipliers, record.individuals, led)
    return seen, record.guidance


def _generation(
    plan: Plan,
    seed: int,
    state: RunState,
    queue: SupervisorQueue,
    evaluator: Evaluator,
    led: GuidanceRecord | None,
) -> Step:
    """Lines 4 to 15 of Algorithm 1; `led` is the guidance that made the population."""
    gp, g, before, began = plan.gp, state.generation, evaluator.simulated, perf_counter()
    texts = [to_text(i.tree) for i in state.population]
    worlds = worlds_of(plan, seed, g)
    started = perf_counter()
    population = evaluate(plan, g, state.population, texts, worlds, evaluator)
    evaluation, supervision = perf_counter() - started, 0.0
    now = measure(
        [e.outcome for e in population],
        [e.verdict for e in population],
        [size(e.individual.tree) for e in population],
        plan.classes,
        plan.curriculum,
        generation=g,
        rate=state.rate,
    )
    history = (*state.history, now)
    seen = view(plan, history)
    archive = remember(state.archive, population, plan.classes.kept, now.stage)
    lines = tuple(line(e, text) for e, text in zip(population, texts, strict=True))
    champion = fittest(state.champion, g, lines)
    guidance = following = None
    if g + 1 < gp.generations:
        asked = perf_counter()
        if g + plan.switches.lag + 1 < gp.generations:  # else the answer would come too late
            multipliers = plan.curriculum.multipliers(now.stage)
            queue.ask(seen, Seen(now, worlds, multipliers, lines, led))
        answer = queue.answer(g)
        supervision = perf_counter() - asked
        guidance, tree = decide(plan, seen, answer, state.rate)
        rate = guidance.applied_rate
        made = next_population(
            plan,
            population,
            seed=seed,
            generation=g + 1,
            injected=tree,
            archive=archive,
            diversity=now.diversity,
        )
        children = mutated(plan, made, seed, g + 1, rate)
        following = RunState(g + 1, children, rate, history, archive, champion)
    record = GenerationRecord(
        snapshot=now,
        worlds=worlds,
        origins=dict(Counter(i.origin.value for i in state.population)),
        stagnant_generations=seen.stagnant_generations,
        individuals=lines,
        guidance=guidance,
    )
    cost = Cost(
        evaluation=evaluation,
        supervision=supervision,
        operators=perf_counter() - began - evaluation - supervision,
        episodes=len(population) * gp.episodes,
        simulated=evaluator.simulated - before,
        llm=queue.spent(),
    )
    return Step(record, following, champion, cost)


def mutated(
    plan: Plan, population: Sequence[Individual], seed: int, generation: int, rate: float
) -> tuple[Individual, ...]:
    """Line 15: mutation after construction, of all where `gp.mutate_elites` (section 2.4.3)."""
    new = []
    for slot, i in enumerate(population):
        if plan.gp.mutate_elites or i.origin not in SPARED:
            rng = stream(seed, Stream.MUTATION, generation=generation, slot=slot)
            how = plan.gp.mutation
            tree, operator = mutate(rng, i.tree, rate=rate, space=plan.space, how=how)
            i = replace(i, tree=tree, mutation=operator)
        new.append(i)
    return tuple(new)


def decide(
    plan: Plan, state: PopulationState, answer: Guidance | None, rate: float
) -> tuple[GuidanceRecord, Node | None]:
    """The answer with what is done with it, and the tree that goes into the population, if any.

    `rate` is the mutation rate in force, and an `answer` of None is not due yet (`lag`).
    """
    given = answer or Guidance(None, None, "none", reasoning="no answer is due yet")
    wanted = given.mutation_rate if plan.switches.adapt_mutation else None
    # An emergency does not outlast its crisis where the rate is not adapted.
    held = rate if plan.switches.adapt_mutation else plan.gp.mutation_rate
    refused = ""
    if given.tree is not None:
        if not plan.switches.inject:
            refused = "injection is switched off"
        elif not within(given.tree, plan.gp.limits):
            refused = "the tree breaks the limits"
    tree = None if refused else given.tree
    record = GuidanceRecord(
        asked_at=None if answer is None else state.now.generation - plan.switches.lag,
        source=given.source,
        phase=given.phase,
        pattern=given.pattern,
        target=given.target,
        intervention=given.intervention,
        wanted_rate=given.mutation_rate,
        crisis=state.crisis,
        applied_rate=plan.gp.crisis.rate(held if wanted is None else wanted, state.crisis),
        tree=None if given.tree is None else to_text(given.tree),
        injected=tree is not None,
        refused=refused,
        risk=given.risk,
        reasoning=given.reasoning,
        rationale=given.rationale,
        notes=given.notes,
    )
    return record, tree
