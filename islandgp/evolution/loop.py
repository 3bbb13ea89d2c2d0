"""The evolution loop: ask the search, evaluate, record, ask the supervisor, update the search.

With `search=paper` this is Algorithm 1, supervised genetic programming (section 2.4.3). The loop
reads and writes no files. Each step is a function of the run's state, so a run that is resumed
from any of its states has the same records.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass
from math import inf
from time import perf_counter

from islandgp.bt.core.language import to_text
from islandgp.bt.core.node import size
from islandgp.domain import Outcome, total
from islandgp.evaluation.base import EarlyEvaluator, Evaluator, Job, evaluated
from islandgp.evolution.edit_trials import compare_with_parents
from islandgp.evolution.search_calls import asked_of, restored, updated_search
from islandgp.gp.archive import ArchiveUpdate, Elite, update_archive
from islandgp.gp.plan import Plan
from islandgp.gp.population import Advice, Evaluated, Individual
from islandgp.gp.record import (
    Cost,
    GenerationRecord,
    GuidanceRecord,
    IndividualRecord,
    RunState,
    Step,
    to_record,
    updated_champion,
)
from islandgp.scoring.classes import classify
from islandgp.scoring.constraints import violation
from islandgp.scoring.generation_stats import GenerationStats, generation_stats
from islandgp.scoring.state import PopulationState, population_state
from islandgp.search.base import Search, SearchState
from islandgp.search.paper import Paper
from islandgp.seeding import Stream, Streams, seed_of
from islandgp.supervision.base import GenerationView, Supervisor
from islandgp.supervision.guidance import SupervisorQueue, decide, nameable


def training_seeds(plan: Plan, seed: int, generation: int) -> tuple[int, ...]:
    """World seeds of a generation: one per episode, or one per individual and episode."""
    since = {"generation": generation, "epoch": plan.curriculum.epoch(generation), "never": 0}
    n = plan.gp.episodes * (1 if plan.gp.shared_seed else plan.gp.population)
    day = since[plan.gp.reseed_every]
    return tuple(seed_of(seed, Stream.WORLD, generation=day, slot=i) for i in range(n))


def jobs_of(
    plan: Plan,
    generation: int,
    slot: int,
    individual: Individual,
    text: str,
    worlds: Sequence[int],
) -> list[Job]:
    """The episodes of the individual in a slot; `text` is its canonical text."""
    n, stage = plan.gp.episodes, plan.curriculum.stage(generation)
    first = 0 if plan.gp.shared_seed else slot * n
    return [Job(text, stage, world, individual.tree) for world in worlds[first : first + n]]


def evaluate(
    plan: Plan,
    generation: int,
    population: Sequence[Individual],
    texts: Sequence[str],
    worlds: Sequence[int],
    evaluator: Evaluator,
) -> tuple[Evaluated, ...]:
    """Evaluates individuals in the worlds; `texts` are their canonical texts."""
    n = plan.gp.episodes
    jobs = [
        job
        for slot, (individual, text) in enumerate(zip(population, texts, strict=True))
        for job in jobs_of(plan, generation, slot, individual, text, worlds)
    ]
    outcomes = evaluator.evaluate(jobs)
    results = []
    for k, individual in enumerate(population):
        episodes = outcomes[k * n : (k + 1) * n]
        o, points = mean_outcome(episodes), tuple(episode.fitness for episode in episodes)
        broken = violation(o.counters, plan.constraints)
        labels = classify(o, plan.classes)
        results.append(Evaluated(individual, o, labels, o.fitness, points, broken))
    return tuple(results)


def mean_outcome(outcomes: Sequence[Outcome]) -> Outcome:
    """The mean outcome of several episodes, number by number."""
    if len(outcomes) == 1:
        return outcomes[0]
    first, n = outcomes[0], len(outcomes)
    return Outcome(
        components={c: total(o.components[c] for o in outcomes) / n for c in first.components},
        counters={c: total(o.counters[c] for o in outcomes) / n for c in first.counters},
        seconds=total(o.seconds for o in outcomes) / n,
        endings=tuple(ending for o in outcomes for ending in o.endings),
    )


def view(plan: Plan, history: Sequence[GenerationStats]) -> PopulationState:
    """Line 6: the state of the population (Table 5) after the last generation of `history`."""
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


def initial_state(plan: Plan, search: Search) -> RunState:
    """The state before generation 0, with the initial mutation rate (lines 1 and 2)."""
    return RunState(0, Advice(plan.gp.mutation_rate), (), search.start().memory, None)


def evolve(
    plan: Plan,
    seed: int,
    supervisor: Supervisor,
    evaluator: Evaluator,
    *,
    search: Search | None = None,
    start: RunState | None = None,
    past: Iterable[GenerationRecord] = (),
    library: Callable[[], int] = lambda: 0,
) -> Generator[Step, None, None]:
    """Yields a step for each generation from `start` to the last one.

    Args:
        plan: of the run.
        seed: of the run, in [0, 2**63).
        supervisor: asked once per generation.
        evaluator: runs the episodes.
        search: decides which trees are evaluated; default: the paper's.
        start: the state to continue from; default: generation 0.
        past: records of the generations before `start`, from 0 on; needed only by supervisors
            that use more than the state.
        library: returns the episodes of the search for the library that the run has used so far.

    Raises:
        EvaluationError, SupervisionError: the run cannot continue.
    """
    search = Paper(plan) if search is None else search
    start = (
        initial_state(plan, search) if start is None else restored(start, search, plan.vocabulary)
    )
    lag = plan.switches.lag
    queue = SupervisorQueue(supervisor, seed=seed, lag=lag, vocabulary=plan.vocabulary)
    try:
        records, led = iter(past), None
        recent: deque[Sequence[IndividualRecord]] = deque(maxlen=lag)
        for g in range(start.generation):
            seen, led = _seen(plan, next(records, None), led)
            if seen is not None:
                recent.append(seen.individuals)
            if g >= start.generation - lag:
                queue.ask(view(plan, start.history[: g + 1]), seen)
            elif seen is not None:
                queue.recall(seen)
        parts = _Parts(plan, Streams(seed), search, evaluator, library)
        state: RunState | None = start
        while state is not None:
            step = _generation(parts, state, queue, led, recent)
            yield step
            state, led = step.state, step.record.guidance
            recent.append(step.record.individuals)
    finally:
        queue.close()


def _seen(
    plan: Plan, record: GenerationRecord | None, led: GuidanceRecord | None
) -> tuple[GenerationView | None, GuidanceRecord | None]:
    """The supervisor's view of a record, and the guidance for the generation after it."""
    if record is None:
        return None, None
    now = record.snapshot
    multipliers = plan.curriculum.multipliers(now.stage)
    seen = GenerationView(
        now, record.worlds, multipliers, record.individuals, led, trials=record.trials
    )
    return seen, record.guidance


@dataclass(frozen=True, slots=True)
class _Parts:
    """The constant parts of a run."""

    plan: Plan
    streams: Streams
    search: Search
    evaluator: Evaluator
    library: Callable[[], int]


def _generation(
    parts: _Parts,
    state: RunState,
    queue: SupervisorQueue,
    led: GuidanceRecord | None,
    recent: Iterable[Sequence[IndividualRecord]],
) -> Step:
    """One generation (lines 4 to 15 of Algorithm 1).

    Args:
        parts: of the run.
        state: of the run before this generation.
        queue: of the supervisor's answers.
        led: the guidance for this generation.
        recent: individuals of the last generations, as many as the supervisor's lag.
    """
    plan, evaluator, g = parts.plan, parts.evaluator, state.generation
    before, began = evaluator.simulated, perf_counter()
    search_state = SearchState(g, state.memory, state.advice)
    worlds = training_seeds(plan, parts.streams.seed, g)
    individuals, texts, started = newcomers(parts, search_state, worlds)
    population = evaluate(plan, g, individuals, texts, worlds, evaluator)
    archive = archived(parts, state.archive, population, texts, worlds, g)
    stage = plan.curriculum.stage(g)
    trials, extra = compare_with_parents(
        plan, population, texts, worlds, state.edit_parents, evaluator, stage=stage
    )
    evaluation, supervision = perf_counter() - started, 0.0
    now = generation_stats(
        [e.outcome for e in population],
        [e.labels for e in population],
        [size(e.individual.tree) for e in population],
        plan.classes,
        plan.curriculum,
        generation=g,
        rate=state.advice.rate,
        constraints=plan.constraints,
    )
    history = (*state.history, now)
    seen = view(plan, history)
    lines = tuple(to_record(e, text) for e, text in zip(population, texts, strict=True))
    champion = updated_champion(state.champion, g, lines, plan.constraints)
    library = max(state.library, parts.library())
    elsewhere = library - state.library
    episodes = len(population) * plan.gp.episodes + archive.episodes + extra
    stopped = plan.stop.reason(population)
    guidance = following = None
    if not stopped and not plan.last(g, state.spent + episodes + elsewhere):
        waiting = perf_counter()
        if g + plan.switches.lag + 1 < plan.gp.generations:  # a later answer could not take effect
            multipliers = plan.curriculum.multipliers(now.stage)
            elites = () if plan.switches.lag else archive.elites
            queue.ask(seen, GenerationView(now, worlds, multipliers, lines, led, elites, trials))
        answer = queue.answer(g)
        supervision = perf_counter() - waiting
        library = max(library, parts.library())
        elsewhere = library - state.library + (0 if answer is None else answer.episodes)
        names = nameable((*recent, lines), archive.elites) if plan.switches.edits else {}
        guidance, advice = decide(
            plan, parts.search, seen, answer, state.advice.rate, names=names, streams=parts.streams
        )
        updated = updated_search(parts.search, search_state, population, advice, plan.vocabulary)
        following = RunState(
            g + 1,
            advice,
            history,
            updated.memory,
            champion,
            state.spent + episodes + elsewhere,
            library,
            archive.elites,
            {e.parents[0]: names[e.parents[0]] for e in advice.edited},
        )
    record = GenerationRecord(
        snapshot=now,
        worlds=worlds,
        origins=dict(Counter(i.origin.value for i in individuals)),
        stagnant_generations=seen.stagnant_generations,
        individuals=lines,
        guidance=guidance,
        archive=archive.record,
        trials=trials,
    )
    cost = Cost(
        evaluation=evaluation,
        supervision=supervision,
        operators=perf_counter() - began - evaluation - supervision,
        episodes=episodes + elsewhere,
        simulated=evaluator.simulated - before,
        llm=queue.spent(),
        elsewhere=elsewhere,
    )
    return Step(record, following, champion, cost, stopped, archive.elites)


def newcomers(
    parts: _Parts, state: SearchState, worlds: Sequence[int]
) -> tuple[list[Individual], list[str], float]:
    """The individuals of a generation, their texts, and when their first episode can have started.

    Episodes start while the search makes the next individuals, if the evaluator supports it.
    """
    plan, evaluator, g = parts.plan, parts.evaluator, state.generation
    individuals: list[Individual] = []
    texts: list[str] = []
    started = inf
    for slot, individual in enumerate(asked_of(parts.search, state, parts.streams, plan)):
        individuals.append(individual)
        texts.append(to_text(individual.tree))
        if isinstance(evaluator, EarlyEvaluator):
            started = min(started, perf_counter())
            for job in jobs_of(plan, g, slot, individual, texts[-1], worlds):
                evaluator.start(job)
    return individuals, texts, min(started, perf_counter())


def archived(
    parts: _Parts,
    before: Sequence[Elite],
    population: Sequence[Evaluated],
    texts: Sequence[str],
    worlds: Sequence[int],
    generation: int,
) -> ArchiveUpdate:
    """The archive after a generation; elites are re-evaluated in worlds of a separate stream."""
    plan, seed = parts.plan, parts.streams.seed
    stage, n = plan.curriculum.stage(generation), plan.gp.episodes
    meets = [
        seed_of(seed, Stream.ARCHIVE, generation=generation, slot=i)
        for i in range(plan.archive.reevaluations)
    ]
    nodes = {text: e.individual.tree for text, e in zip(texts, population, strict=True)}
    return update_archive(
        before,
        population,
        texts,
        [worlds[0 if plan.gp.shared_seed else i * n] for i in range(len(population))],
        plan.archive,
        plan.classes,
        stage=stage,
        episodes=n,
        reevaluate=lambda trees: evaluated(
            parts.evaluator, [nodes.get(text, text) for text in trees], stage, meets
        ),
        constraints=plan.constraints,
    )
