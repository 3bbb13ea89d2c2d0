"""Searches of `conf/search` on the fake evaluator, and evaluated individuals for them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from islandgp.bt.core.language import parse
from islandgp.evolution.generation import evaluate, training_seeds
from islandgp.gp.plan import Plan
from islandgp.gp.population import Advice, Evaluated, Individual, Origin
from islandgp.resources import resource
from islandgp.running.parts import make_search, plan_of
from islandgp.scoring.classes import classify
from islandgp.search.base import SearchState
from islandgp.seeding import Streams
from tests.composed import composed
from tests.evolution.fake import Fake
from tests.samples import CLASSES, outcome

SMALL = ("supervisor=baseline", "gp.population=12", "gp.generations=7")
NAMES = sorted(path.stem for path in (resource("conf") / "search").glob("*.yaml"))
"""Every search that the package ships."""

NO_ADVICE = Advice(rate=0.4)


def search_and_plan(name: str, *overrides: str) -> tuple[Any, Plan]:
    """The search that the configuration chooses, and its plan."""
    settings = composed(*SMALL, f"search={name}", *overrides)
    plan = plan_of(settings, settings.make_domain())
    return make_search(settings, plan), plan


def individual(name: str, tree: str = "PatrolWaypoint") -> Individual:
    """An individual of that id."""
    return Individual(name, parse(tree), Origin.RANDOM)


def evaluated(
    name: str,
    fitness: float = 0.0,
    *,
    tree: str = "PatrolWaypoint",
    components: dict[str, float] | None = None,
    episodes: Sequence[float] = (),
    **counters: float,
) -> Evaluated:
    """An individual with these points and counters."""
    o = outcome(None if components else fitness, components=components, **counters)
    return Evaluated(individual(name, tree), o, classify(o, CLASSES), o.fitness, tuple(episodes))


def generations(
    search: Any, plan: Plan, n: int, *, seed: int = 1, advice: Advice = NO_ADVICE
) -> tuple[list[tuple[Evaluated, ...]], SearchState]:
    """The first generations, evaluated by the fake, and the state after them."""
    streams, fake, state, populations = Streams(seed), Fake(), search.start(), []
    for g in range(n):
        population = search.ask(state, streams)
        populations.append(evaluate(plan, g, population, training_seeds(plan, seed, g), fake)[0])
        state = search.tell(state, populations[-1], advice)
    return populations, state
