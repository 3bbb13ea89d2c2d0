"""The evaluation of a generation: its individuals, their episodes, the archive, the statistics."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter

from islandgp.bt.core.language import to_text
from islandgp.domain import Outcome, total
from islandgp.evaluation.base import Evaluator, Job, evaluated
from islandgp.evolution.search_calls import asked_of
from islandgp.gp.archive import ArchiveUpdate, Elite, cell_of, update_archive
from islandgp.gp.edits import EditTrial
from islandgp.gp.plan import Plan
from islandgp.gp.population import Evaluated, Individual, Origin
from islandgp.gp.record import IndividualRecord, RunState, to_record
from islandgp.gp.state import generation_stats
from islandgp.scoring.classes import classify
from islandgp.scoring.constraints import mean_violation, violation
from islandgp.scoring.generation_stats import GenerationStats
from islandgp.search.base import Search, SearchState
from islandgp.seeding import Stream, Streams, seed_of


@dataclass(frozen=True, slots=True)
class Parts:
    """The constant parts of a run."""

    plan: Plan
    streams: Streams
    search: Search
    evaluator: Evaluator
    library_episodes: int  # of the search for a library


@dataclass(frozen=True, slots=True)
class EvaluatedGeneration:
    """A generation after its episodes."""

    worlds: tuple[int, ...]  # seeds
    population: tuple[Evaluated, ...]  # by slot
    records: tuple[IndividualRecord, ...]  # by slot
    stats: GenerationStats
    archive: ArchiveUpdate
    trials: tuple[EditTrial, ...]  # edited trees against the trees before
    episodes: int  # of the population, the archive and the trials
    seconds: float  # from the start of the first episode to the end of the last


def evaluate_generation(
    parts: Parts, state: RunState, search_state: SearchState
) -> EvaluatedGeneration:
    """Asks the search for individuals and evaluates them, with the archive and the trials of edits.

    Args:
        parts: of the run.
        state: of the run before the generation.
        search_state: of the search, for the same generation.

    Raises:
        EvaluationError: an episode failed.
        PartError: a search of the user failed.
    """
    plan, g = parts.plan, state.generation
    worlds = training_seeds(plan, parts.streams.seed, g)
    individuals = asked_of(parts.search, search_state, parts.streams, plan)
    population, records, started = evaluate(plan, g, individuals, worlds, parts.evaluator)
    archive = archived(parts, state.archive, population, records, worlds, g)
    trials, of_trials = compare_with_parents(
        parts, population, records, worlds, state.edit_parents, stage=plan.curriculum.stage(g)
    )
    seconds = perf_counter() - started
    stats = generation_stats(plan, g, state.advice.rate, population)
    return EvaluatedGeneration(
        worlds,
        population,
        records,
        stats,
        archive,
        trials,
        len(population) * plan.gp.episodes + archive.episodes + of_trials,
        seconds,
    )


def training_seeds(plan: Plan, seed: int, generation: int) -> tuple[int, ...]:
    """World seeds of a generation: one per episode, or one per individual and episode."""
    since = {"generation": generation, "epoch": plan.curriculum.epoch(generation), "never": 0}
    n = plan.gp.episodes * (1 if plan.gp.shared_seed else plan.gp.population)
    drawn_at = since[plan.gp.reseed_every]
    return tuple(seed_of(seed, Stream.WORLD, generation=drawn_at, slot=i) for i in range(n))


def worlds_of(plan: Plan, worlds: Sequence[int], slot: int) -> tuple[int, ...]:
    """The worlds of the individual in a slot, of the worlds of a generation."""
    n = plan.gp.episodes
    at = 0 if plan.gp.shared_seed else slot * n
    return tuple(worlds[at : at + n])


def evaluate(
    plan: Plan,
    generation: int,
    individuals: Iterable[Individual],
    worlds: Sequence[int],
    evaluator: Evaluator,
) -> tuple[tuple[Evaluated, ...], tuple[IndividualRecord, ...], float]:
    """The evaluated individuals, their records, and when their episodes started.

    Episodes start while the next individuals are made, if the evaluator supports it.
    """
    n, stage = plan.gp.episodes, plan.curriculum.stage(generation)
    made: list[Individual] = []
    texts: list[str] = []

    def jobs() -> Iterator[Job]:
        for slot, individual in enumerate(individuals):
            made.append(individual)
            texts.append(to_text(individual.tree))
            for world in worlds_of(plan, worlds, slot):
                yield Job(texts[-1], stage, world, individual.tree)

    batch = jobs() if getattr(evaluator, "early", False) else list(jobs())
    started = perf_counter()
    outcomes = evaluator.evaluate(batch)
    results = []
    for k, individual in enumerate(made):
        episodes = outcomes[k * n : (k + 1) * n]
        o, points = mean_outcome(episodes), tuple(episode.fitness for episode in episodes)
        excess = violation(o.counters, plan.constraints)
        labels = classify(o, plan.classes)
        results.append(Evaluated(individual, o, labels, o.fitness, points, excess))
    records = tuple([to_record(e, text) for e, text in zip(results, texts, strict=True)])
    return tuple(results), records, started


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
        observed=tuple(each for o in outcomes for each in o.observed),
    )


def mean_fitness(outcomes: Sequence[Outcome]) -> float:
    """The mean fitness of several episodes, points."""
    return float(total(o.fitness for o in outcomes) / len(outcomes))


def archived(
    parts: Parts,
    before: Sequence[Elite],
    population: Sequence[Evaluated],
    records: Sequence[IndividualRecord],
    worlds: Sequence[int],
    generation: int,
) -> ArchiveUpdate:
    """The archive after a generation; elites are re-evaluated in worlds of a separate stream."""
    plan, seed = parts.plan, parts.streams.seed
    stage, n = plan.curriculum.stage(generation), plan.gp.episodes
    worlds_of_elites = [
        seed_of(seed, Stream.ARCHIVE, generation=generation, slot=i)
        for i in range(plan.archive.reevaluations)
    ]
    nodes = {r.tree: e.individual.tree for r, e in zip(records, population, strict=True)}
    axes = plan.archive.axes(plan.classes)
    individuals = [
        (
            Elite(
                cell_of(e.outcome.counters, axes),
                r.id,
                r.tree,
                stage,
                n,
                e.fitness,
                worlds_of(plan, worlds, slot)[0],
            ),
            e.violation > 0,
        )
        for slot, (e, r) in enumerate(zip(population, records, strict=True))
    ]

    def reevaluate(trees: Sequence[str]) -> list[float | None]:
        asked = [nodes.get(text, text) for text in trees]
        results = evaluated(parts.evaluator, asked, stage, worlds_of_elites)
        return [
            None if mean_violation(outcomes, plan.constraints) else mean_fitness(outcomes)
            for outcomes in results
        ]

    return update_archive(before, individuals, axes, plan.archive, reevaluate)


def compare_with_parents(
    parts: Parts,
    population: Sequence[Evaluated],
    records: Sequence[IndividualRecord],
    worlds: Sequence[int],
    parents: Mapping[str, str],
    *,
    stage: int,
) -> tuple[tuple[EditTrial, ...], int]:
    """Compares each edited tree with the original tree in the same worlds.

    An original tree that is in the population, and so was evaluated in these worlds, is not
    evaluated again.

    Args:
        parts: of the run.
        population: the generation, evaluated.
        records: of its individuals.
        worlds: of the generation.
        parents: texts of the original trees by id.
        stage: of the curriculum.

    Returns:
        The comparisons, and the number of additional episodes.
    """
    seeds = [worlds_of(parts.plan, worlds, slot) for slot in range(len(population))]
    fitness = {(r.tree, own): r.fitness for r, own in zip(records, seeds, strict=True)}
    edited = [
        (e.individual, (parents[e.individual.parents[0]], own), e.fitness)
        for e, own in zip(population, seeds, strict=True)
        if e.individual.origin == Origin.EDITED and e.individual.parents[0] in parents
    ]
    missing = [key for key in dict.fromkeys(key for _, key, _ in edited) if key not in fitness]
    for text, own in missing:
        (outcomes,) = evaluated(parts.evaluator, [text], stage, own)
        fitness[text, own] = mean_fitness(outcomes)
    trials = tuple(
        EditTrial(i.id, i.parents[0], points, fitness[original]) for i, original, points in edited
    )
    return trials, len(missing) * parts.plan.gp.episodes
