"""How large random trees become: the estimate against trees that are made."""

from __future__ import annotations

from statistics import fmean

import numpy as np
import pytest

from islandgp.bt.core.node import size
from islandgp.gp.random_trees import MAX_EXPECTED_NODES, TreeSettings, expected_nodes, grow
from tests.composed import composed, composed_plan


def trees(**changes: object) -> TreeSettings:
    """The default settings with changes."""
    return composed().gp.trees.model_copy(update=changes)


def test_exact_sizes() -> None:
    """Where nothing is left to chance the mean is the size itself."""
    chain = trees(kinds={"inverter": 1.0}, leaf=0.0)
    assert [expected_nodes(chain, depth) for depth in (1, 2, 7)] == [1, 2, 7]
    pairs = trees(kinds={"sequence": 1.0}, leaf=0.0, children=(2, 2))
    assert [expected_nodes(pairs, depth) for depth in (1, 2, 3, 6)] == [1, 3, 7, 63]
    assert expected_nodes(trees(leaf=1.0), 50) == 1


@pytest.mark.parametrize("depth", [2, 4, 6])
def test_the_mean_of_trees_that_are_made(depth: int) -> None:
    """By the default weights, over a thousand trees."""
    rng, space = np.random.default_rng(1), composed_plan().space
    mean = fmean(size(grow(rng, space, depth)) for _ in range(1000))
    assert mean == pytest.approx(expected_nodes(space.settings, depth), rel=0.1)


def test_counting_ends() -> None:
    """However deep the trees are."""
    assert expected_nodes(trees(leaf=0.0), 10**9) > MAX_EXPECTED_NODES
