"""Random trees of the evolution's kind, and what they do on the island tick by tick."""

from __future__ import annotations

from typing import TypeAlias

from islandgp.bt.core.engine import ABORTED
from islandgp.bt.core.node import Node, walk
from islandgp.config.settings import Settings
from islandgp.domain import Outcome
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.gp.random_trees import TreeSpace, random_tree
from islandgp.seeding import Stream, stream

Tick: TypeAlias = tuple[tuple[tuple[str, bool, int], ...], tuple[str, ...], int]
Trace: TypeAlias = list[Tick]  # per tick: calls (action, fresh, status), aborted actions, status


def random_trees(settings: Settings, count: int) -> list[Node]:
    """The random trees of a run with seed 0; every second one is a larger tree than usual."""
    usual = settings.gp.trees
    large = usual.model_copy(update={"depth": (4, 7), "leaf": 0.2})
    spaces = [TreeSpace(shape, VOCABULARY, settings.gp.limits) for shape in (usual, large)]
    return [random_tree(stream(0, Stream.INITIAL, slot=i), spaces[i % 2]) for i in range(count)]


Event: TypeAlias = tuple[int, str, str, float]  # tick, event, component, points


class Follower:
    """An observer that keeps the reports of a domain, tick by tick."""

    def __init__(self, tree: Node) -> None:
        self.leaves = {i: n.action for i, n in enumerate(walk(tree)) if n.action}
        self.ticks: list[list[tuple[str, int]]] = []  # actions with their statuses
        self.events: list[Event] = []
        self._called: list[tuple[str, int]] = []
        self._aborted: list[tuple[str, int]] = []

    def node(self, place: int, status: int) -> None:
        if place in self.leaves:
            changes = self._aborted if status == ABORTED else self._called
            changes.append((self.leaves[place], status))

    def credit(self, component: str, points: float, event: str, _: str) -> None:
        self.events.append((len(self.ticks), event, component, points))

    def tick(self, *_: object) -> None:
        # Aborts of one tick come in document order per subtree, so their order is not compared.
        self.ticks.append([*self._called, *sorted(self._aborted)])
        self._called.clear()
        self._aborted.clear()


def shortened(settings: Settings, seconds: float, **limits: float) -> Settings:
    """The same settings with episodes of at most so many seconds."""
    episode = settings.world.episode.model_copy(update={"length": seconds, **limits})
    return settings.model_copy(
        update={"world": settings.world.model_copy(update={"episode": episode})}
    )


def island_trace(
    settings: Settings, tree: Node, seed: int, seconds: float
) -> tuple[list[list[tuple[str, int]]], list[Event], Outcome]:
    """Per tick the actions with their statuses, the events, and the outcome."""
    follower = Follower(tree)
    domain = shortened(settings, seconds).make_domain()
    outcome = domain.run_episode(tree, seed, settings.curriculum.multipliers(3), follower)
    return follower.ticks, follower.events, outcome
