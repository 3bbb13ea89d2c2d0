"""Counts ticks in which two actions hold one resource: python -m tests.domains.shared_resources."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence

import numpy as np

import islandgp
from islandgp.bt.core.engine import ABORTED
from islandgp.bt.core.node import RUNNING, Node, walk
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.domain import Scene
from islandgp.evaluation.base import Problem
from islandgp.gp.random_trees import TreeSpace
from islandgp.search.breeding import Breeding, Parent, new_child, new_tree

DOMAINS = {
    **dict.fromkeys(
        ("island", "cartpole", "lunarlander", "mountaincar", "pendulum", "swimmer"), None
    ),
    "pick_place": "examples/pick_place/conf",
    "minigrid": "examples/minigrid/conf",
}
"""Configuration folder of each shipped domain."""
PARENTS = 100  # latest trees, of which the parents of a child are drawn


class Holders:
    """An observer that counts the ticks in which two leaves hold one resource.

    A leaf holds the resources of its action from its first tick until it ends or is aborted.
    """

    scenes = False

    def __init__(self, tree: Node, vocabulary: Vocabulary) -> None:
        self.shared = 0  # ticks
        self._uses = {
            place: frozenset(vocabulary.action(node.action).uses)
            for place, node in enumerate(walk(tree))
            if node.action
        }
        self._calls: list[tuple[int, int]] = []  # leaf and status, in this tick
        self._holding: set[int] = set()  # leaves that were RUNNING after the last tick

    def node(self, place: int, status: int) -> None:
        """See `Observer`."""
        if place in self._uses:
            self._calls.append((place, status))

    def credit(self, component: str, points: float, event: str, action: str) -> None:
        """See `Observer`."""

    def tick(self, board: Sequence[float], scene: Scene | None) -> None:  # noqa: ARG002 -- see `Observer`
        """See `Observer`. A leaf that is only aborted in a tick holds nothing in it."""
        last = {place: at for at, (place, _) in enumerate(self._calls)}
        called = {place for place, status in self._calls if status != ABORTED}
        holding = {place for place in self._holding if place not in last or place in called}
        shares = False
        for place, status in self._calls:
            if status == ABORTED:
                holding.discard(place)
                continue
            others = (other for other in holding if other != place)
            shares |= any(self._uses[other] & self._uses[place] for other in others)
            (holding.add if status == RUNNING else holding.discard)(place)
        self.shared += shares
        self._holding, self._calls = holding, []


def trees(
    rng: np.random.Generator, space: TreeSpace, kinds: Sequence[Breeding], n: int
) -> Iterator[Node]:
    """`n` random trees, then `n` children of earlier trees, with each kind of breeding in turn."""
    made: list[Node] = []
    for i in range(2 * n):
        breeding = kinds[i % len(kinds)]
        if i < n:
            made.append(new_tree(rng, space, breeding))
        else:
            recent = [Parent("", made[-1 - int(k)]) for k in rng.integers(PARENTS, size=2) % i]
            made.append(new_child(rng, recent[0], recent[1:], space, breeding).tree)
        yield made[-1]


def row(name: str, config_dir: str | None, n: int) -> str:
    """A row of the table."""
    kinds = []
    for breeding in ("branches", "paper"):
        experiment = islandgp.compose(
            f"domain={name}", f"search/breeding={breeding}", "tracking=off", config_dir=config_dir
        )
        kinds.append(Breeding.model_validate(experiment.settings.search.policy["breeding"]))
    problem: Problem = experiment.settings.problem()
    vocabulary = problem.domain.schema.vocabulary
    declared = sum(bool(a.uses) for a in vocabulary.actions.values())
    needed = sum(not a.condition for a in vocabulary.actions.values())
    rng, weights = np.random.default_rng(7), problem.curriculum.multipliers(0)
    ticks = parallel = 0
    for seed, tree in enumerate(trees(rng, experiment.plan.space, kinds, n)):
        holders = Holders(tree, vocabulary)
        problem.in_world(0, seed).run_episode(tree, seed, weights, holders)
        ticks += holders.shared
        parallel += any(
            node.kind in ("parallel", "pipeline", "reactive_sequence") for node in walk(tree)
        )
    return f"| {name} | {declared} of {needed} | {2 * n:,} | {parallel:,} | {ticks:,} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.domains.shared_resources", description=__doc__
    )
    parser.add_argument("--trees", type=int, default=1000, help="random trees; as many are bred")
    n = parser.parse_args().trees
    print("| domain | actions with resources | trees | with concurrent nodes | shared ticks |")
    print("|---|---:|---:|---:|---:|")
    for name, config_dir in DOMAINS.items():
        print(row(name, config_dir, n), flush=True)


if __name__ == "__main__":
    main()
