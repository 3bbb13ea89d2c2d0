"""Recorded episodes that several tests look at, made once; and a domain as small as one can be."""

# ruff: noqa: ARG001, ARG002, ARG005 -- a domain as small as one can be needs little

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, ClassVar, Self

from pydantic import BaseModel

from islandgp.bt.core.engine import compile_tree
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import RUNNING, SUCCESS, Limits, Node, size
from islandgp.bt.core.vocabulary import Action, Vocabulary, flag, number
from islandgp.domain import (
    Domain,
    Event,
    Observer,
    Outcome,
    RewardTable,
    Scene,
    Schema,
    Shape,
    ShapeStyle,
)
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.evaluation.base import Problem
from islandgp.gp.random_trees import TreeSpace, random_tree
from islandgp.resources import resource
from islandgp.scoring.curriculum import Curriculum, Stage
from islandgp.seeding import Stream, stream
from islandgp.viewer.recording import Recording, record
from tests.composed import composed


@cache
def example(name: str) -> Node:
    """A tree of grammar/examples."""
    return parse((resource("grammar") / "examples" / f"{name}.bt").read_text(encoding="utf-8"))


@cache
def island(**limits: float) -> Problem:
    """The island with the paper's numbers, but for limits of the episode."""
    settings = composed()
    if limits:
        episode = settings.world.episode.model_copy(update=limits)
        world = settings.world.model_copy(update={"episode": episode})
        settings = settings.model_copy(update={"world": world})
    return Problem(settings.make_domain(), settings.curriculum)


@cache
def recorded(name: str = "all_rounder", seed: int = 1) -> Recording:
    """An example's whole episode in the last stage."""
    return record(example(name), island(), seed=seed, stage=3)


@cache
def random_of_size(nodes: int) -> Node:
    """A random tree with exactly so many nodes."""
    settings = composed("gp.trees.kinds.parallel=0.5").gp.trees
    settings = settings.model_copy(update={"depth": (4, 8), "leaf": 0.2})
    space = TreeSpace(settings, VOCABULARY, Limits(8, nodes))
    for slot in range(100_000):
        tree = random_tree(stream(0, Stream.INITIAL, slot=slot), space)
        if size(tree) == nodes:
            return tree
    raise AssertionError(f"no random tree of {nodes} nodes found")


@dataclass
class Small(Domain):
    """Twenty ticks of a robot that goes or stays, with the scenes that a test gives it."""

    World: ClassVar[type[BaseModel]] = BaseModel
    Rewards: ClassVar[type[BaseModel]] = RewardTable

    scenes: Sequence[Scene | None] = ()  # one a tick, the last one again and again
    ticks: int = 20
    silent: bool = False  # reports no tick to its observer
    step_s: float = 0.5
    points: float = 0.25  # a tick in which it goes
    schema: Schema = field(
        default_factory=lambda: Schema(
            vocabulary=Vocabulary(
                "small",
                {"Go": Action("goes on"), "Stay": Action("stays")},
                {"far": flag("it has gone far"), "way": number("steps gone", 0, 20)},
            ),
            components={"going": "going on", "unused": "nothing"},
            events={"step": Event("a step is made")},
            task="Go.",
            styles={
                "robot": ShapeStyle("robot", "R", "triangle"),
                "stone": ShapeStyle("stone", "o"),
            },
        )
    )

    @classmethod
    def make(cls, *_: Any) -> Self:
        return cls()

    def run_episode(
        self,
        tree: Node,
        seed: int,
        weights: Mapping[str, float],
        observer: Observer | None = None,
    ) -> Outcome:
        board, distance, points = [0.0, 0.0], 0, 0.0

        def go(fresh: bool) -> int:
            nonlocal distance, points
            distance, points = distance + 1, points + self.points
            if observer is not None:
                observer.credit("going", self.points, "step", "Go")
            return RUNNING

        watch = None if observer is None else observer.node
        actions = {"Go": go, "Stay": lambda fresh: SUCCESS}
        tick = compile_tree(tree, actions, board, self.schema.vocabulary.key_index, watch=watch)
        for number_ in range(self.ticks):
            tick()
            if observer is not None and not self.silent:
                scenes = self.scenes
                observer.tick(board, scenes[min(number_, len(scenes) - 1)] if scenes else None)
            board[:] = [float(distance > 10), float(distance)]
        return Outcome(
            {"going": points, "unused": 0.0},
            {"step": distance},
            self.ticks * self.step_s,
            ("time",),
        )


def small(text: str = "selector { Go }", **changes: Any) -> Recording:
    """A recorded episode of `Small`."""
    curriculum = Curriculum(generations_per_epoch=1, stages=(Stage(epochs=(1, 1), multipliers={}),))
    return record(parse(text), Problem(Small(**changes), curriculum), seed=0, stage=0)


def going(ticks: int = 20) -> list[Scene]:
    """Scenes of a robot that goes to the right, past a stone that is gone after five ticks."""
    return [
        Scene(
            bounds=(0, 0, 20, 10),
            fixed=(Shape("stone", 10, 9, 1),),
            items=(Shape("stone", 3, 3, 0.5, "here"),) if tick < 5 else (),
            movers=(Shape("robot", float(tick), 5.0, 0.5, str(tick // 10)),),
        )
        for tick in range(ticks)
    ]
