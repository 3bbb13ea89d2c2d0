"""User operators: a wrong return value is reported as their author's fault."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from islandgp.bt.core.node import Limits, Node, leaf
from islandgp.errors import PartError
from islandgp.gp.population import Evaluated
from islandgp.gp.random_trees import TreeSpace
from islandgp.gp.variation import MutationSettings
from tests.evolution.runs import plan, run

HERE = __name__
LEAF = leaf("PatrolWaypoint")


def two_children(_: np.random.Generator, mother: Node, father: Node, __: Limits) -> object:
    """A pair, as many libraries have it."""
    return mother, father


def too_large(_: np.random.Generator, __: Node, ___: Node, limits: Limits) -> Node:
    """One node more than there may be."""
    return Node("sequence", (), (LEAF,) * limits.max_nodes)


def text(_: np.random.Generator, __: Node, ___: TreeSpace, ____: MutationSettings) -> object:
    """A tree's text."""
    return "PatrolWaypoint"


def foreign(_: np.random.Generator, __: Node, ___: TreeSpace, ____: MutationSettings) -> Node:
    """An action of another domain."""
    return leaf("PushLeft")


def tree_of_the_first(_: np.random.Generator, population: Sequence[Evaluated], __: int) -> object:
    """The tree of an individual, instead of the individual."""
    return population[0].individual.tree


@pytest.mark.parametrize(
    ("key", "name", "message"),
    [
        ("gp.crossover", "two_children", "expected it to return a tree .Node., found tuple"),
        ("gp.crossover", "too_large", "a tree of at most 50 nodes and depth 8, found 51 nodes"),
        ("gp.mutation.operators", "text", "expected it to return a tree .Node., found str"),
        ("gp.mutation.operators", "foreign", "expected actions of the domain .*, found PushLeft"),
        ("gp.selection", "tree_of_the_first", "an individual .Evaluated., found Node"),
    ],
)
def test_a_wrong_return_value_of_an_operator_is_reported(key: str, name: str, message: str) -> None:
    """With its path and what was expected, at the first generation that it makes."""
    path = f"{HERE}:{name}"
    weighed = key == "gp.mutation.operators"
    override = (
        f"+{key}={{{path.replace(':', chr(92) + ':')}:100}}" if weighed else f"{key}='{path}'"
    )
    with pytest.raises(PartError, match=rf"{path} failed \(.*{message}"):
        run(plan("gp.population=12", "gp.generations=3", override))
