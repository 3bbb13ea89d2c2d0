"""The evolution loop: ask the search, evaluate, record, ask the supervisor, update the search.

With `search=paper` this is Algorithm 1, supervised genetic programming (section 2.4.3). The loop
reads and writes no files. Each step is a function of the run's state, so a run that is resumed
from any of its states has the same records.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Iterable
from dataclasses import dataclass
from itertools import islice
from time import perf_counter

from islandgp.evaluation.base import Evaluator
from islandgp.evolution.generation import EvaluatedGeneration, Parts, evaluate_generation
from islandgp.evolution.search_calls import findings, restored, updated_memory
from islandgp.gp.plan import Plan
from islandgp.gp.population import Advice
from islandgp.gp.record import (
    Cost,
    GenerationRecord,
    GuidanceRecord,
    RunState,
    Step,
    updated_champion,
)
from islandgp.gp.state import population_state
from islandgp.scoring.state import PopulationState
from islandgp.search.base import Search, SearchState
from islandgp.seeding import Streams
from islandgp.supervision.base import GenerationView, Guidance, Supervisor
from islandgp.supervision.guidance import SupervisorCalls, decide, nameable


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
    library_episodes: int = 0,
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
        library_episodes: of the search for a library, which generation 0 counts.

    Raises:
        EvaluationError, SupervisionError: the run cannot continue.
    """
    if search is None:
        from islandgp.search.paper import Paper  # only for this search

        search = Paper(plan)
    start = (
        initial_state(plan, search) if start is None else restored(start, search, plan.vocabulary)
    )
    calls = SupervisorCalls(supervisor, seed=seed, vocabulary=plan.vocabulary)
    try:
        parts = Parts(plan, Streams(seed), search, evaluator, library_episodes)
        loop = _Loop(parts, calls)
        loop.recall(start, past)
        state: RunState | None = start
        while state is not None:
            step = loop.step(state)
            yield step
            state = step.state
    finally:
        calls.close()


@dataclass(slots=True)
class _Loop:
    """A run in progress."""

    parts: Parts
    supervisor: SupervisorCalls
    guidance: GuidanceRecord | None = None  # for the next generation that is evaluated

    def recall(self, start: RunState, past: Iterable[GenerationRecord]) -> None:
        """Passes the generations before `start` to the supervisor, as far as there are records."""
        for record in islice(past, start.generation):
            self.supervisor.recall(self._recorded(record))
            self.guidance = record.guidance

    def _recorded(self, record: GenerationRecord) -> GenerationView:
        """The supervisor's view of a recorded generation."""
        now = record.snapshot
        multipliers = self.parts.plan.curriculum.multipliers(now.stage)
        return GenerationView(
            now, record.worlds, multipliers, record.individuals, self.guidance, trials=record.trials
        )

    def step(self, state: RunState) -> Step:
        """Evaluates a generation and prepares the next (lines 4 to 15 of Algorithm 1)."""
        parts, plan, g = self.parts, self.parts.plan, state.generation
        began, waited = perf_counter(), 0.0
        search_state = SearchState(g, state.memory, state.advice)
        done = evaluate_generation(parts, state, search_state)
        history = (*state.history, done.stats)
        population = population_state(plan, history)
        champion = updated_champion(state.champion, g, done.records, plan.constraints)
        library = 0 if g else parts.library_episodes
        outside = library  # episodes outside training
        stopped = plan.stop.reason(done.population)
        guidance = following = None
        if not stopped and plan.left(g, state.spent + done.episodes + outside) > 0:
            waiting = perf_counter()
            answer = self._answer(state, done, population)
            waited = perf_counter() - waiting
            outside += answer.episodes
            names = nameable(done.records, done.archive.elites) if plan.switches.edits else {}
            rate = state.advice.rate
            guidance, advice = decide(plan, parts.search, population, answer, rate, names)
            memory = updated_memory(parts.search, search_state, done.population, advice, plan)
            spent = state.spent + done.episodes + outside
            parents = {e.parents[0]: names[e.parents[0]] for e in advice.edited}
            elites = done.archive.elites
            following = RunState(g + 1, advice, history, memory, champion, spent, elites, parents)
        record = GenerationRecord(
            snapshot=done.stats,
            worlds=done.worlds,
            origins=dict(Counter(e.individual.origin.value for e in done.population)),
            stagnant_generations=population.stagnant_generations,
            individuals=done.records,
            guidance=guidance,
            archive=done.archive.record,
            trials=done.trials,
        )
        cost = Cost(
            evaluation=done.seconds,
            supervision=waited,
            operators=perf_counter() - began - done.seconds - waited,
            episodes=done.episodes + outside,
            llm=self.supervisor.spent(),
            outside_training=outside,
            library=library,
        )
        self.guidance = guidance
        return Step(record, following, champion, cost, stopped, done.archive.elites)

    def _answer(
        self, state: RunState, done: EvaluatedGeneration, population: PopulationState
    ) -> Guidance:
        """Asks the supervisor about a generation."""
        plan, now = self.parts.plan, done.stats
        view = GenerationView(
            now,
            done.worlds,
            plan.curriculum.multipliers(now.stage),
            done.records,
            self.guidance,
            done.archive.elites,
            trials=done.trials,
            learned=tuple(findings(self.parts.search, state, plan.vocabulary)),
        )
        return self.supervisor.ask(population, view)
