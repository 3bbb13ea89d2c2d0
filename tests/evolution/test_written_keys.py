"""Evolution writes keys, and uses other kinds of nodes, if their weights are above 0."""

from __future__ import annotations

import numpy as np
import pytest

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Limits, SetArgs, walk
from islandgp.bt.core.vocabulary import Action, Vocabulary, enumeration, flag, integer
from islandgp.errors import ConfigError
from islandgp.gp.random_trees import TreeSpace, random_tree
from islandgp.gp.variation import mutate
from tests.composed import composed

ROBOT = Vocabulary(
    "bot",
    {"Go": Action()},
    {
        "n": integer("", 0, 5, initial=0),
        "mode": enumeration("", ("a", "b"), initial="a"),
        "on": flag("", initial="no"),
        "seen": flag(""),
    },
)


def test_weights_of_other_kinds_act() -> None:
    """Random trees have assignments of all keys that trees write, and leaves that always end so."""
    weights = {"sequence": 1.0, "set": 1.0, "always": 0.3, "if_else": 1.0, "random_selector": 1.0}
    settings = composed().gp.trees.model_copy(update={"kinds": weights})
    space = TreeSpace(settings, ROBOT, Limits(6, 30))
    trees = [random_tree(np.random.default_rng(seed), space) for seed in range(80)]
    nodes = [node for tree in trees for node in walk(tree)]
    assert {node.kind for node in nodes} == {*weights, "action"}
    written = {node.args.assigned.key for node in nodes if isinstance(node.args, SetArgs)}
    assert written == {"n", "mode", "on"}
    policy = composed().gp.mutation
    for seed, tree in enumerate(trees):
        assert parse(to_text(tree), ROBOT) == tree
        rng = np.random.default_rng(seed)
        changed, _ = mutate(rng, tree, rate=1.0, space=space, settings=policy)
        assert parse(to_text(changed), ROBOT) == changed


def test_without_keys_that_trees_write() -> None:
    """On the island no tree writes a key, so that a weight of `set` is an error."""
    with pytest.raises(ConfigError, match=r"gp\.trees\.kinds\.set: expected 0, found 1"):
        composed("gp.trees.kinds.set=1")
