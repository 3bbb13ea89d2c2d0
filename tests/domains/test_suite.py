"""Every domain that comes with the project keeps the contract."""

from __future__ import annotations

import sys
from collections.abc import Callable
from copy import copy
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

from islandgp.bt.core.node import FAILURE
from islandgp.domain import Domain
from islandgp.evaluation.base import Problem
from islandgp.gate import user_folder
from islandgp.testing import Check, check_domain
from tests.composed import plain

EXAMPLES = Path(__file__).parents[2] / "examples"


def island() -> Domain:
    """The island, with short episodes."""
    return Problem.recorded(plain("world.episode.length=40")).domain


@cache
def pick_place() -> Domain:
    """The tutorial's domain, as its configuration makes it."""
    folder = EXAMPLES / "pick_place"
    if str(folder) not in sys.path:
        sys.path.append(str(folder))
    config = yaml.safe_load((folder / "conf/domain/pick_place.yaml").read_text(encoding="utf-8"))
    with user_folder(folder / "conf"):
        return Problem.recorded(config).domain


CARRY = (EXAMPLES / "pick_place" / "carry.bt").read_text(encoding="utf-8")


def check_pick_place(make: Callable[[], Domain]) -> Check:
    """The check with the tutorial's tree and few others."""
    return check_domain(make, trees=[CARRY], random_trees=4)


def test_the_island_keeps_its_promises() -> None:
    """With a few trees; no actions seem to share a resource that they do not declare."""
    check = check_domain(island, random_trees=4)
    assert (check.faults, check.shared()) == ({}, [])


def test_the_tutorial_keeps_its_promises() -> None:
    """And its tree reaches everything that the schema declares."""
    check = check_pick_place(pick_place)
    assert (check.faults, check.unreached()) == ({}, [])


def test_a_failure_is_located(monkeypatch: pytest.MonkeyPatch) -> None:
    """The file and the line of the user's code, with Python's message."""
    episode: Any = type(pick_place()).Episode  # type: ignore[attr-defined] -- a SimulatorDomain's
    sense = lambda _: 1 / 0  # noqa: E731
    monkeypatch.setattr(episode, "sense", sense)
    (fault,) = check_pick_place(pick_place).faults.values()
    assert fault.startswith("Expected no error")
    line = sense.__code__.co_firstlineno
    place = f"{__file__}, line {line} (world seed 0, tree Localise)"
    assert fault.partition(", in ")[2] == place


def test_broken_promises_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """A domain that keeps state between episodes gets a message."""
    domain: Any = pick_place()

    class Forgetful(domain.Episode):  # type: ignore[misc, name-defined]
        episodes = 0

        def __init__(self, world: object, seed: int, log: object) -> None:
            type(self).episodes += 1
            super().__init__(world, seed + self.episodes, log)

    monkeypatch.setattr(type(domain), "Episode", Forgetful)
    faults = check_pick_place(pick_place).faults
    assert "an episode is a function of tree seed and weights" in faults


def test_a_status_that_an_action_has_only_behind_another_is_found() -> None:
    """Where the robot does not know its place, it fails at once; only behind `Localise` it runs."""
    domain = copy(pick_place())
    words = domain.schema.vocabulary
    declared = replace(words.actions["MoveToPick"], statuses=frozenset({FAILURE}))
    changed = replace(words, actions={**words.actions, "MoveToPick": declared})
    domain.schema = replace(domain.schema, vocabulary=changed)  # type: ignore[misc]
    faults = check_domain(lambda: domain, random_trees=0).faults
    message = faults["actions return the statuses that they declare"]
    assert message == "Expected MoveToPick to return FAILURE, found RUNNING."


def test_actions_that_seem_to_share_a_resource_are_listed() -> None:
    """Two drives of one base are, as long as they do not declare it; tucking twice is not."""

    def undeclared() -> Domain:
        domain = copy(pick_place())
        words = domain.schema.vocabulary
        actions = {name: replace(a, uses=()) for name, a in words.actions.items()}
        domain.schema = replace(domain.schema, vocabulary=replace(words, actions=actions))  # type: ignore[misc]
        return domain

    check = check_domain(undeclared, random_trees=0)
    assert "  MoveToPick and MoveToPlace" in check.lines()
    assert "Tuck with itself" not in check.shared()
    declared = check_domain(pick_place, random_trees=0)
    assert "MoveToPick and MoveToPlace" not in declared.shared()
