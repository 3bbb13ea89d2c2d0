"""Every domain that comes with the project keeps the contract."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path

import pytest
import yaml

from islandgp.domain import Domain
from islandgp.evaluation.recorded import setting_of
from islandgp.testing.domain_suite import DomainSuite, run_suite
from tests.composed import plain

EXAMPLES = Path(__file__).parents[2] / "examples"


class TestIsland(DomainSuite):
    """The island, with short episodes."""

    random_trees = 8

    def make_domain(self) -> Domain:
        return setting_of(plain("world.episode.length=60")).domain


class TestPickPlace(DomainSuite):
    """The domain of the tutorial."""

    texts = ((EXAMPLES / "pick_place" / "carry.bt").read_text(encoding="utf-8"),)

    def make_domain(self) -> Domain:
        return pick_place()


@cache
def pick_place() -> Domain:
    """The tutorial's domain, as its configuration makes it."""
    folder = EXAMPLES / "pick_place"
    if str(folder) not in sys.path:
        sys.path.append(str(folder))
    config = yaml.safe_load((folder / "conf/domain/pick_place.yaml").read_text(encoding="utf-8"))
    return setting_of(config).domain


def test_the_suite_finds_what_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    """A domain that keeps state between episodes, or breaks a range, is told in words."""

    class Broken(TestPickPlace):
        def make_domain(self) -> Domain:
            domain = super().make_domain()
            episode = type(domain).Episode  # type: ignore[attr-defined] -- a Stepped domain's

            class Forgetful(episode):  # type: ignore[misc, valid-type] -- found at run time
                made = 0

                def __init__(self, world: object, seed: int, log: object) -> None:
                    type(self).made += 1
                    super().__init__(world, seed + self.made, log)

                def sense(self) -> dict[str, float]:
                    return {**super().sense(), "blocks_left": 12.0}

            monkeypatch.setattr(type(domain), "Episode", Forgetful)
            return domain

    found = {promise: fault for promise, fault in run_suite(Broken()) if fault}
    assert "an episode is a function of tree seed and weights" in found
    assert "Expected blocks_left <= 9, found 12.0" in found["the blackboard keeps its ranges"]
