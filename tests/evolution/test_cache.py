"""The cache of episodes saves work and changes no record."""

from __future__ import annotations

from dataclasses import asdict

import pytest

from islandgp.evaluation import base
from islandgp.evaluation.base import Cached, Job
from islandgp.evolution.loop import evolve
from islandgp.gp.record import Step
from islandgp.records.files import dump
from islandgp.running.parts import make_evaluator, make_search, make_supervisor
from tests.composed import composed, composed_plan
from tests.evolution.fake import Fake, outcome_of
from tests.profiles import sweep

RUN = (
    "evaluator=serial",
    "gp.population=12",
    "gp.generations=6",
    "gp.mutate_elites=false",  # so that elites come back as they were
    "world.episode.length=15",
)


def steps(*overrides: str) -> list[Step]:
    """A run with real, short episodes."""
    settings = composed(*RUN, *overrides)
    evaluator = make_evaluator(settings)
    supervisor = make_supervisor(settings, None)
    try:
        return list(evolve(composed_plan(*RUN, *overrides), settings.seed, supervisor, evaluator))
    finally:
        evaluator.close()


@sweep("reseed_every", ["never", "generation"], quick=1)
def test_records_are_the_same_with_and_without(reseed_every: str) -> None:
    """Off switch and on switch give the same bytes; only on saves episodes, and counts them."""
    worlds = f"gp.reseed_every={reseed_every}"
    cached, plain = steps(worlds), steps(worlds, "evaluator.cache=false")
    assert [dump(asdict(s.record)) for s in cached] == [dump(asdict(s.record)) for s in plain]
    assert [dump(asdict(s.champion)) for s in cached] == [dump(asdict(s.champion)) for s in plain]
    assert all(s.cost.simulated == s.cost.episodes == 12 for s in plain)
    assert all(s.cost.episodes == 12 for s in cached)
    saved = [s.cost.episodes - s.cost.simulated for s in cached]
    assert sum(saved) > 0
    if reseed_every == "never":
        assert all(hits >= 1 for hits in saved[1:]), "elites are known from the generation before"


def test_what_makes_an_episode_another_one() -> None:
    """Another tree, stage or seed is simulated; the same job is not, in this batch and the next."""
    inner = Fake()
    cached = Cached(inner)
    job = Job("PatrolWaypoint\n", 0, 1)
    others = [Job("SeekCharger\n", 0, 1), Job(job.tree, 1, 1), Job(job.tree, 0, 2)]
    batch = [job, *others, job]
    assert cached.evaluate(batch) == [outcome_of(j) for j in batch]
    assert inner.batches == [[job, *others]]
    assert cached.evaluate([job, others[0]]) == [outcome_of(job), outcome_of(others[0])]
    assert inner.batches[1:] == [[]]
    assert cached.simulated == 4


def test_cached_outcomes_outlast_other_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    """Such as the archive's between two generations; the oldest ones go where there are many."""
    monkeypatch.setattr(base, "MAX_CACHED", 3)
    cached = Cached(Fake())
    jobs = [Job("PatrolWaypoint\n", 0, seed) for seed in range(4)]
    for batch in (jobs[:2], jobs[2:3], jobs[:2]):
        cached.evaluate(batch)
    assert cached.simulated == 3
    cached.evaluate(jobs[3:])
    cached.evaluate(jobs[1:])
    assert cached.simulated == 4
    cached.evaluate(jobs[:1])
    assert cached.simulated == 5


def test_no_search_simulates_an_episode_twice() -> None:
    """Also with an archive, whose elites meet other worlds between two generations."""
    settings = composed(*RUN, "search=racing", "gp.reseed_every=never")
    fake = Fake()
    plan = composed_plan(*RUN, "search=racing", "gp.reseed_every=never")
    supervisor = make_supervisor(settings, None)
    search = make_search(settings, plan)
    run = evolve(plan, settings.seed, supervisor, Cached(fake), search=search)
    costs = [step.cost for step in run]
    simulated = [job for batch in fake.batches for job in batch]
    assert len(simulated) == len({*simulated}) == sum(each.simulated for each in costs)
    assert len(simulated) < sum(each.episodes for each in costs)
