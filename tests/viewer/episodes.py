"""Recorded episodes that several tests look at, made once."""

from __future__ import annotations

from functools import cache

from islandgp.bt.language import parse
from islandgp.bt.limits import Limits
from islandgp.bt.node import Node, size
from islandgp.evolution.generation import random_tree
from islandgp.resources import resource
from islandgp.seeding import Stream, stream
from islandgp.viewer.recording import Recording, record
from tests.composed import composed


@cache
def example(name: str) -> Node:
    """A tree of grammar/examples."""
    return parse((resource("grammar") / "examples" / f"{name}.bt").read_text(encoding="utf-8"))


@cache
def recorded(name: str = "all_rounder", seed: int = 1) -> Recording:
    """An example's whole episode in the last stage."""
    return record(example(name), composed(), seed=seed, stage=3)


@cache
def random_of_size(nodes: int) -> Node:
    """A random tree with exactly so many nodes."""
    settings = composed().gp.trees.model_copy(update={"depth": (4, 8), "leaf": 0.2})
    for slot in range(100_000):
        tree = random_tree(stream(0, Stream.INITIAL, slot=slot), settings, Limits(8, nodes))
        if size(tree) == nodes:
            return tree
    raise AssertionError(f"no random tree of {nodes} nodes found")
