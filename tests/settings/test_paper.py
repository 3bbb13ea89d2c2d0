"""Every number that the paper states is in `conf/`, under the key that docs/paper.md names."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from islandgp.bt.core.node import size
from islandgp.gp.random_trees import random_tree
from islandgp.running.parts import make_library
from islandgp.scoring.classes import INTEGRATION, RARE
from islandgp.seeding import Stream, stream
from islandgp.supervision.expert import Expert
from tests.composed import composed, plain

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
BAND = [{"below": 15, "points": 800}, {"below": 25, "points": 400}, {"below": 45, "points": 200}]

PAPER: list[tuple[str, str, Any]] = [
    # the place in the paper, the key, the value
    ("2.2.2", "world.side", 300),
    ("2.2.2", "world.start", [150, 150]),
    ("2.2.2", "world.robot.capacity", 30),
    ("2.2.2", "world.robot.battery_start", 70),
    ("2.2.3", "world.robot.perception", 15),
    ("Table 3", "world.robot.patrol_segment", 20),
    ("2.2.2", "world.episode.length", 420),
    ("2.2.2", "world.episode.stagnation", 120),
    ("2.2.2", "world.episode.stagnation_low_battery", 180),
    ("2.2.2", "world.episode.low_battery", 40),
    ("2.2.2", "world.episode.negative", 60),
    ("2.2.3", "gp.max_depth", 8),
    ("2.2.3", "gp.max_nodes", 50),
    ("2.3", "gp.population", 30),
    ("2.3", "gp.tournament_size", 3),
    ("2.3", "gp.crossover_rate", 0.8),
    ("2.3.1", "gp.generations", 41),
    ("2.4.3", "gp.mutate_elites", True),
    ("2.3.1", "curriculum.generations_per_epoch", 5),
    ("Table 1", "allocation.per", 30),
    ("Table 1", "allocation.elites", 2),
    ("Table 1", "allocation.behavioural_elites", 5),
    ("Table 1", "allocation.resurrected", 2),
    ("Table 1", "allocation.diversity", [2, 4]),
    ("Table 1", "allocation.tournament_children", [18, 25]),
    ("Table 3", "rewards.events.pickup", {"component": "garbage", "base": 200, "per_unit": 100}),
    ("Table 3", "rewards.events.interaction",
     {"component": "humanoid", "base": 360, "per_unit": 45}),
    ("Table 3", "rewards.events.delivery", {"component": "delivery", "base": 100, "per_unit": 30}),
    ("Table 3", "rewards.events.empty_delivery", {"component": "delivery", "base": -150}),
    ("Table 3", "rewards.events.charge",
     {"component": "battery", "bands": BAND, "base": 20, "per_unit": 1}),
    ("Table 3", "rewards.events.shutdown", {"component": "battery", "base": -3000}),
    ("Table 3", "rewards.events.patrol", {"component": "patrol", "base": 13}),
    ("Table 3", "rewards.events.discovery", {"component": "patrol", "per_unit": 10}),
    ("Table 3", "rewards.events.idle", {"component": "idle", "base": -10, "over": 20}),
    ("Table 3", "rewards.events.collision", {"component": "collision", "base": -500}),
    ("Table 3", "rewards.events.leftover", {"component": "leftover", "per_unit": -20}),
    ("Table 4", "classes.tiers.excellent.at_least",
     {"pickups": 4, "interactions": 2, "deliveries": 2, "gathered": 6}),
    ("Table 4", "classes.tiers.excellent.above", {"fitness": 30000}),
    ("Table 4", "classes.tiers.complete",
     {"at_least": {"pickups": 2, "interactions": 1, "deliveries": 1, "charges": 1}}),
    ("Table 4", "classes.tiers.full_service",
     {"at_least": {"pickups": 1, "interactions": 1, "deliveries": 1, "charges": 1}}),
    ("Table 4", "classes.tiers.balanced_elite", {"above": {"gathered": 8, "fitness": 15000}}),
    ("Table 8", "supervisor.policy.rates.early_exploration", [0.40, 0.50]),
    ("Table 8", "supervisor.policy.rates.exploitation", [0.10, 0.20]),
    ("Table 8", "supervisor.policy.rates.refinement", [0.15, 0.25]),
    ("Table 8", "supervisor.policy.rates.balanced_optimization", [0.18, 0.28]),
    ("Table 8", "supervisor.policy.rates.balanced_exploration", [0.30, 0.40]),
    ("Table 8", "supervisor.policy.rates.aggressive_exploration", [0.35, 0.45]),
    ("Table 8", "supervisor.policy.rates.crisis_intervention", [0.45, 0.50]),
]  # fmt: skip

TABLE_2 = [
    # epochs, garbage, battery, humanoid, delivery, leftover
    ([1, 2], 2.0, 1.0, 1.5, 1.0, 0.8),
    ([3, 4], 1.8, 2.5, 1.5, 1.2, 1.0),
    ([5, 6], 1.6, 2.0, 1.8, 2.5, 1.5),
    ([7, 8], 1.5, 1.8, 2.0, 2.0, 2.0),
]

LLM: list[tuple[str, str, Any]] = [
    ("2.4.5", "supervisor.policy.model", "claude-haiku-4-5-20251001"),
    ("2.4.5", "supervisor.policy.max_tokens", 2048),
    ("2.4.5", "supervisor.policy.temperature", 0.7),
    ("2.4.5", "supervisor.policy.retry.attempts", 3),
    ("2.4.5", "supervisor.policy.retry.deadline", 30),
    ("2.4.6", "supervisor.policy.explore.depth", 4),
    ("2.4.6", "supervisor.policy.explore.nodes", "8 to 10"),
    ("2.4.6", "supervisor.policy.exploit.depth", 6),
    ("2.4.6", "supervisor.policy.exploit.nodes", "25"),
]


def at(config: Any, key: str) -> Any:
    """The value under a dotted key."""
    for part in key.split("."):
        config = config[part]
    return config


@pytest.mark.parametrize(("section", "key", "value"), PAPER)
def test_numbers(section: str, key: str, value: object) -> None:
    """The default configuration, or that of the paper's slots, has the paper's number."""
    words = ["search=paper"] if section == "Table 1" else []
    assert at(plain(*words), key) == value, section


def test_table_2() -> None:
    """The multipliers of the four stages."""
    rows = [
        (stage["epochs"], *stage["multipliers"].values())
        for stage in plain()["curriculum"]["stages"]
    ]
    assert list(plain()["curriculum"]["stages"][0]["multipliers"]) == [
        "garbage", "battery", "humanoid", "delivery", "leftover",
    ]  # fmt: skip
    assert rows == TABLE_2


@pytest.mark.parametrize(("section", "key", "value"), LLM)
def test_llm_numbers(section: str, key: str, value: object) -> None:
    """`supervisor=llm` has the paper's model, limits and sizes."""
    assert at(plain("supervisor=llm"), key) == value, section


def test_docs_name_the_keys() -> None:
    """docs/paper.md names the key of each of the paper's numbers."""
    named = set(re.findall(r"`([a-z_.]+)`", TEXT))
    missing = [
        key
        for _, key, _ in PAPER + LLM
        if not any(key == name or key.startswith(f"{name}.") for name in named)
    ]
    assert missing == []


def test_docs_name_keys_that_exist() -> None:
    """Each dotted key that docs/paper.md names is in some configuration."""
    default, llm = plain(), plain("supervisor=llm")
    groups = {key for key in default if isinstance(default[key], dict)}
    named = {
        name
        for name in re.findall(r"`([a-z_]+\.[a-z_.]+)`", TEXT)
        if name.split(".")[0] in groups and not name.endswith(".py")
    }
    assert len(named) > 40

    def exists(config: Any, key: str) -> bool:
        try:
            at(config, key)
        except (KeyError, TypeError):
            return False
        return True

    others = (plain("supervisor=baseline"), plain("search=paper"))
    absent = [k for k in sorted(named) if not any(exists(c, k) for c in (default, llm, *others))]
    assert absent == []


def test_docs_name_files_that_exist() -> None:
    """Each file and folder that docs/paper.md names is there."""
    named = set(re.findall(r"`([a-z0-9_/]+/|[a-z0-9_/]+\.(?:py|lark|yaml))`", TEXT))
    assert len(named) > 25
    absent = [
        n for n in sorted(named) if not any((ROOT / top / n).exists() for top in ("islandgp", ""))
    ]
    assert absent == []


def test_docs_state_the_size_of_random_trees() -> None:
    """6,000 random trees, and the trees that the expert injects until a Complete Robot exists."""
    settings = composed()
    domain = settings.make_domain()
    space = settings.plan(domain).space
    sizes = [
        size(random_tree(stream(seed, Stream.INITIAL, slot=slot), space))
        for seed in range(200)
        for slot in range(30)
    ]
    least, median, most, nearly_all = np.percentile(sizes, [25, 50, 75, 95])
    library = make_library(settings, domain)
    expert = Expert(settings.supervisor.settings(), library, settings.classes)
    injected = [
        size(library.trees[name])
        for target in settings.classes.targets
        if target not in (RARE, INTEGRATION)
        for name in expert.fitting(target, compact=True)
    ]
    text = " ".join(TEXT.split())
    assert f"the median has {median:g} nodes, half have {least:g} to {most:g}" in text
    assert f"{nearly_all:g}, the largest {max(sizes)}" in text
    assert min(injected) == max(injected)
    assert f"have {min(injected)} nodes each" in text
