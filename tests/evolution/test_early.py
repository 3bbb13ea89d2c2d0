"""Episodes that start while the search makes the next individuals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from islandgp.evaluation.base import Job
from islandgp.evolution.loop import evolve
from islandgp.gp.population import Individual
from islandgp.gp.record import Step
from islandgp.search.base import SearchState
from islandgp.search.hill import Hill
from islandgp.seeding import Streams
from tests.evolution.fake import Fake
from tests.evolution.runs import Constant, lines, plan
from tests.search.searches import search_and_plan


class Early(Fake):
    """See `EarlyEvaluator`; keeps the jobs that were started."""

    def __init__(self) -> None:
        super().__init__()
        self.started: list[Job] = []

    def start(self, job: Job) -> None:
        """See `EarlyEvaluator`."""
        self.started.append(job)


def hill(kind: type[Hill]) -> Hill:
    """A small search."""
    search, search_plan = search_and_plan("hill")
    return kind(search.settings, search_plan)


def steps(evaluator: Fake, kind: type[Hill] = Hill, *overrides: str) -> list[Step]:
    """Three generations of 12 individuals, two episodes each."""
    early_plan = plan("gp.generations=3", "gp.episodes=2", *overrides)
    return list(evolve(early_plan, 1, Constant(), evaluator, search=hill(kind)))


def test_every_job_of_a_generation_starts_early_and_records_are_the_same() -> None:
    """The jobs of `evaluate` start in their order."""
    early, plain = Early(), Fake()
    assert list(lines(steps(early))) == list(lines(steps(plain)))
    jobs = [job for batch in early.batches if len(batch) == 24 for job in batch]
    assert early.started == jobs
    assert len(jobs) == 3 * 24


def test_the_further_episodes_of_elites_start_early() -> None:
    """They run while the generation is summarized, and records are the same."""
    early, plain = Early(), Fake()
    further = "archive.reevaluations=1"
    assert list(lines(steps(early, Hill, further))) == list(lines(steps(plain, Hill, further)))
    assert early.started == [job for batch in early.batches for job in batch]
    assert len(early.batches) > 3


def test_an_episode_starts_before_the_next_individual_is_made() -> None:
    """When a search makes an individual, the episodes of those before it have started."""
    evaluator, starts = Early(), list[int]()

    class Watched(Hill):
        def ask_each(self, state: SearchState, streams: Streams) -> Iterator[Individual]:
            for individual in super().ask_each(state, streams):
                starts.append(len(evaluator.started))
                yield individual

    steps(evaluator, Watched)
    assert starts == list(range(0, 3 * 24, 2))


def test_a_subclass_that_changes_ask_is_asked() -> None:
    """`ask_each` of its base class would yield other individuals."""

    class Reversed(Hill):
        def ask(self, state: SearchState, streams: Streams) -> tuple[Individual, ...]:
            individuals = super().ask(state, streams)
            trees = [i.tree for i in reversed(individuals)]
            return tuple(replace(i, tree=tree) for i, tree in zip(individuals, trees, strict=True))

    usual, changed = (steps(Early(), kind)[0].record.individuals for kind in (Hill, Reversed))
    assert [i.tree for i in changed] == [i.tree for i in usual][::-1]
