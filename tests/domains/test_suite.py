"""Every domain that comes with the project keeps the contract."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from copy import copy
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import ClassVar

import pytest
import yaml

from islandgp.bt.core.node import SUCCESS
from islandgp.bt.core.vocabulary import Action
from islandgp.domain import Domain
from islandgp.domains.island import Island
from islandgp.domains.island.actions import IslandAction
from islandgp.evaluation.base import Problem
from islandgp.gate import user_folder
from islandgp.testing.domain_suite import DomainSuite, run_suite
from tests.composed import plain

EXAMPLES = Path(__file__).parents[2] / "examples"


class TestIsland(DomainSuite):
    """The island, with short episodes."""

    random_trees = 4
    grown_trees = 6
    more_episodes = 0

    def make_domain(self) -> Domain:
        return Problem.recorded(plain("world.episode.length=40")).domain


class TestPickPlace(DomainSuite):
    """The domain of the tutorial."""

    texts = ((EXAMPLES / "pick_place" / "carry.bt").read_text(encoding="utf-8"),)
    random_trees = 4
    grown_trees = 20

    def make_domain(self) -> Domain:
        return pick_place()


@cache
def pick_place() -> Domain:
    """The tutorial's domain, as its configuration makes it."""
    folder = EXAMPLES / "pick_place"
    if str(folder) not in sys.path:
        sys.path.append(str(folder))
    config = yaml.safe_load((folder / "conf/domain/pick_place.yaml").read_text(encoding="utf-8"))
    with user_folder(folder / "conf"):
        return Problem.recorded(config).domain


def test_the_suite_locates_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    """The file and the line of the user's code, with Python's message."""

    class Failing(TestPickPlace):
        def make_domain(self) -> Domain:
            domain = super().make_domain()
            monkeypatch.setattr(type(domain).Episode, "sense", lambda _: 1 / 0)  # type: ignore[attr-defined] -- a SimulatorDomain domain's
            return domain

    faults = [fault for _, fault in run_suite(Failing()) if fault.startswith("Expected no error")]
    line = Failing.make_domain.__code__.co_firstlineno + 2
    assert faults
    assert {fault.partition(", in ")[2] for fault in faults} == {
        f"{__file__}, line {line} (world seed 0, tree Localise)"
    }


def test_the_suite_finds_what_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    """A domain that keeps state between episodes, or breaks a range, gets a message."""

    class Broken(TestPickPlace):
        def make_domain(self) -> Domain:
            domain = super().make_domain()
            episode = type(domain).Episode  # type: ignore[attr-defined] -- a SimulatorDomain domain's

            class Forgetful(episode):  # type: ignore[misc, valid-type] -- found at run time
                episodes = 0

                def __init__(self, world: object, seed: int, log: object) -> None:
                    type(self).episodes += 1
                    super().__init__(world, seed + self.episodes, log)

                def sense(self) -> dict[str, float]:
                    return {**super().sense(), "blocks_left": 12.0}

            monkeypatch.setattr(type(domain), "Episode", Forgetful)
            return domain

    faults = {promise: fault for promise, fault in run_suite(Broken()) if fault}
    assert "an episode is a function of tree seed and weights" in faults
    assert "Expected blocks_left <= 9, found 12.0" in faults["keys stay in their ranges"]


def test_a_status_that_an_action_has_only_behind_another_is_found() -> None:
    """Where the robot starts it succeeds at once; only after a drive it runs."""
    declared = Action("drives home", statuses=frozenset({SUCCESS}))

    class Homing(Island):
        schema = Island.schema.with_actions("homing", {"ReturnToStart": declared})
        actions: ClassVar[Mapping[str, IslandAction]] = {
            **Island.actions,
            "ReturnToStart": lambda island, _: island.drive(*island.world.start, 5.0),
        }

    class Suite(TestIsland):
        random_trees = grown_trees = 0

        def make_domain(self) -> Domain:
            island = super().make_domain()
            assert isinstance(island, Island)
            return Homing(island.world, island.rewards)

    with pytest.raises(AssertionError, match=r"ReturnToStart to return SUCCESS, found RUNNING\."):
        Suite().test_actions_return_the_statuses_that_they_declare()


def test_actions_that_seem_to_share_a_resource_are_listed() -> None:
    """Two drives of one base are, as long as they do not declare it; tucking twice is not."""

    class Undeclared(TestPickPlace):
        declares = False

        def make_domain(self) -> Domain:
            domain = copy(pick_place())
            words = domain.schema.vocabulary
            actions = {name: replace(a, uses=()) for name, a in words.actions.items()}
            words = words if self.declares else replace(words, actions=actions)
            domain.schema = replace(domain.schema, vocabulary=words)
            return domain

    class Declared(Undeclared):
        declares = True

    found = {*Undeclared().shared()}
    assert "MoveToPick and MoveToPlace" in found
    assert "Tuck with itself" not in found
    assert "MoveToPick and MoveToPlace" not in {*Declared().shared()}
