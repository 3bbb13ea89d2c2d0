"""Episodes that start while the search makes the next individuals."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from islandgp.domain import Outcome
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
    """An early evaluator; keeps the jobs that were started."""

    def __init__(self) -> None:
        super().__init__()
        self.started: list[Job] = []

    early = True

    def evaluate(self, jobs: Iterable[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        batch = [self.started.append(job) or job for job in jobs]  # type: ignore[func-returns-value]
        return super().evaluate(batch)


def hill(kind: type[Hill]) -> Hill:
    """A small search."""
    search, search_plan = search_and_plan("hill")
    return kind(search.settings, search_plan)


def steps(evaluator: Fake, kind: type[Hill] = Hill, *overrides: str) -> list[Step]:
    """Three generations of 12 individuals, two episodes each."""
    early_plan = plan("gp.generations=3", "gp.episodes=2", *overrides)
    return list(evolve(early_plan, 1, Constant(), evaluator, search=hill(kind)))


def test_early_episodes_give_the_same_records() -> None:
    """An early evaluator gets the jobs one by one, another one gets a list."""
    assert list(lines(steps(Early()))) == list(lines(steps(Fake())))


def test_an_episode_starts_before_the_next_individual_is_made() -> None:
    """When a search makes an individual, the episodes of those before it have started."""
    evaluator, starts = Early(), list[int]()

    class Watched(Hill):
        def ask(self, state: SearchState, streams: Streams) -> Iterator[Individual]:
            for individual in super().ask(state, streams):
                starts.append(len(evaluator.started))
                yield individual

    steps(evaluator, Watched)
    assert starts == list(range(0, 3 * 24, 2))
