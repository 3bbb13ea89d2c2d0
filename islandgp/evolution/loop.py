"""Algorithm 1: supervised genetic programming, as a generator of generations (section 2.4.3).

It reads no file and writes none. Each step is a function of the run's state, so
a run can go on from any of its states and ends in the same bytes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator

from islandgp.bt.language import to_text
from islandgp.evaluation.base import Evaluator
from islandgp.evolution.allocation import next_population
from islandgp.evolution.archive import remember
from islandgp.evolution.decide import decide
from islandgp.evolution.evaluate import evaluate, worlds_of
from islandgp.evolution.generation import random_tree
from islandgp.evolution.meter import Meter
from islandgp.evolution.mutation import mutate_population
from islandgp.evolution.observe import snapshot, view
from islandgp.evolution.plan import Plan
from islandgp.evolution.population import Individual, Origin
from islandgp.evolution.record import GenerationRecord, RunState, Step, fittest, line
from islandgp.seeding import Stream, stream
from islandgp.supervision.base import Supervisor
from islandgp.supervision.lag import Desk


def initial_state(plan: Plan, seed: int) -> RunState:
    """Lines 1 and 2 of Algorithm 1: random trees and the initial mutation rate."""
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
    start = initial_state(plan, seed) if start is None else start
    desk = Desk(supervisor, seed=seed, lag=plan.switches.lag)
    try:
        for g in range(max(0, start.generation - plan.switches.lag), start.generation):
            desk.ask(view(plan, start.history[: g + 1]))
        state: RunState | None = start
        while state is not None:
            step = _generation(plan, seed, state, desk, evaluator)
            yield step
            state = step.state
    finally:
        desk.close()


def _generation(plan: Plan, seed: int, state: RunState, desk: Desk, evaluator: Evaluator) -> Step:
    """Lines 4 to 15 of Algorithm 1."""
    gp, g, meter = plan.gp, state.generation, Meter(evaluator)
    texts = [to_text(i.tree) for i in state.population]
    worlds = worlds_of(plan, seed, g)
    with meter.part("evaluation"):
        population = evaluate(plan, g, state.population, texts, worlds, evaluator)
    now = snapshot(plan, g, population, state.rate)
    history = (*state.history, now)
    seen = view(plan, history)
    archive = remember(state.archive, population)
    lines = tuple(line(e, text) for e, text in zip(population, texts, strict=True))
    champion = fittest(state.champion, g, lines)
    guidance = following = None
    if g + 1 < gp.generations:
        with meter.part("supervision"):
            if g + plan.switches.lag + 1 < gp.generations:  # else nobody waits for the answer
                desk.ask(seen)
            answer = desk.answer(g)
        guidance, tree = decide(plan, seen, answer, state.rate)
        children = next_population(
            population,
            seed=seed,
            generation=g + 1,
            injected=tree,
            archive=archive,
            diversity=now.diversity,
            allocation=plan.allocation,
            trees=gp.trees,
            limits=gp.limits,
            crossover_rate=gp.crossover_rate,
            tournament_size=gp.tournament,
        )
        rate = guidance.applied_rate
        mutated = mutate_population(
            children,
            seed=seed,
            generation=g + 1,
            rate=rate,
            elites_too=gp.mutate_elites,
            trees=gp.trees,
            how=gp.mutation,
            limits=gp.limits,
        )
        following = RunState(g + 1, mutated, rate, history, archive, champion)
    record = GenerationRecord(
        snapshot=now,
        worlds=worlds,
        origins=dict(Counter(i.origin.value for i in state.population)),
        stagnant_generations=seen.stagnant_generations,
        individuals=lines,
        guidance=guidance,
    )
    cost = meter.cost(episodes=len(population) * gp.episodes, llm=desk.spent())
    return Step(record, following, champion, cost)
