"""Section 2.3.1 and Table 2: which generation belongs to which epoch and stage."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from islandgp.domain.rewards import worth
from islandgp.domains.island.vocabulary import SCHEMA
from islandgp.scoring.curriculum import Curriculum
from tests.composed import composed

EPOCHS = [
    # epoch, stage (from 0), its generations
    (1, 0, [0, 1, 2, 3, 4, 5]),
    (2, 0, [6, 7, 8, 9, 10]),
    (3, 1, [11, 12, 13, 14, 15]),
    (4, 1, [16, 17, 18, 19, 20]),
    (5, 2, [21, 22, 23, 24, 25]),
    (6, 2, [26, 27, 28, 29, 30]),
    (7, 3, [31, 32, 33, 34, 35]),
    (8, 3, [36, 37, 38, 39, 40]),
]


def test_every_generation() -> None:
    """Generation 0 and 1-5 are epoch 1, then five generations an epoch, two epochs a stage."""
    curriculum = composed().curriculum
    expected = {g: (epoch, stage) for epoch, stage, generations in EPOCHS for g in generations}
    assert sorted(expected) == list(range(41))
    assert {g: (curriculum.epoch(g), curriculum.stage(g)) for g in range(41)} == expected


def test_the_last_stage_goes_on() -> None:
    """Runs longer than the curriculum stay in its last stage."""
    assert composed().curriculum.stage(41) == composed().curriculum.stage(1000) == 3


def test_flat() -> None:
    """`curriculum=flat` has one stage in which everything counts once."""
    flat = composed("curriculum=flat").curriculum
    assert {flat.stage(g) for g in range(50)} == {0}
    assert set(flat.multipliers(0).values()) <= {1.0}


def test_a_component_that_is_not_named_counts_once() -> None:
    """Table 2 has five columns; the other components are not weighted."""
    multipliers = {
        "generations_per_epoch": 5,
        "stages": [{"epochs": [1, 2], "multipliers": {"delivery": 3}}],
    }
    weights = Curriculum.model_validate(multipliers).multipliers(0)
    assert weights == {"delivery": 3}
    value = worth(composed().rewards, weights)
    assert value("delivery", 10) == ("delivery", 1200)  # 3 * (100 + 10 * 30)
    assert value("pickup", 1) == ("garbage", 300)


@pytest.mark.parametrize("multiplier", [-1, float("nan"), float("inf")])
def test_multipliers_that_cannot_be(multiplier: float) -> None:
    """A multiplier turns no reward into a penalty, and is a number."""
    stage = {"epochs": [1, 2], "multipliers": {"garbage": multiplier}}
    with pytest.raises(ValidationError, match="garbage"):
        Curriculum.model_validate({"generations_per_epoch": 5, "stages": [stage]})


def test_unknown_components_are_reported_with_their_path() -> None:
    """Which components there are is the domain's."""
    stages = [
        {"epochs": [1, 2], "multipliers": {"garbage": 1}},
        {"epochs": [3, 4], "multipliers": {"garbage": 1, "trash": 2}},
    ]
    curriculum = Curriculum.model_validate({"generations_per_epoch": 5, "stages": stages})
    (line,) = curriculum.faults(SCHEMA)
    assert line.startswith("curriculum.stages.1.multipliers.trash: expected one of garbage, ")
    assert line.endswith(", found 'trash'")


@pytest.mark.parametrize(
    "epochs",
    [[(2, 3)], [(1, 2), (4, 5)], [(1, 2), (2, 3)], [(1, 0)], []],
    ids=["starts late", "gap", "overlap", "backwards", "empty"],
)
def test_stages_without_gaps(epochs: list[tuple[int, int]]) -> None:
    """Stages follow each other from epoch 1 on; anything else is refused."""
    ones = dict.fromkeys(("garbage", "battery", "humanoid", "delivery", "leftover"), 1.0)
    stages = [{"epochs": pair, "multipliers": ones} for pair in epochs]
    with pytest.raises(ValidationError):
        Curriculum.model_validate({"generations_per_epoch": 5, "stages": stages})


def test_stages_name_the_same_components() -> None:
    """A component that another stage names has the multiplier 1, as has one that none names."""
    stages = [
        {"epochs": [1, 1], "multipliers": {"garbage": 2}},
        {"epochs": [2, 2], "multipliers": {"battery": 3}},
        {"epochs": [3, 3], "multipliers": {}},
    ]
    curriculum = Curriculum.model_validate({"generations_per_epoch": 1, "stages": stages})
    assert [curriculum.multipliers(stage) for stage in range(3)] == [
        {"garbage": 2, "battery": 1},
        {"garbage": 1, "battery": 3},
        {"garbage": 1, "battery": 1},
    ]
