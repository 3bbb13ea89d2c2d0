"""Classes, labels and tiers of sections 2.3.3 and 2.3.4 at their boundaries."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from islandgp.scoring.classify import (
    Classes,
    Specialist,
    Tier,
    is_charging,
    is_clearing,
    is_working,
    specialist,
    tiers,
)
from tests.composed import composed
from tests.made import outcome

EXCELLENT = {
    "pickups": 4, "interactions": 2, "deliveries": 2, "charges": 1, "gathered": 6, "fitness": 30001,
}  # fmt: skip
COMPLETE = {"pickups": 2, "interactions": 1, "deliveries": 1, "charges": 1}
FULL_SERVICE = {"pickups": 1, "interactions": 1, "deliveries": 1, "charges": 1}
BALANCED_ELITE = {"gathered": 9, "fitness": 15001}


@pytest.mark.parametrize(
    ("pickups", "interactions", "expected"),
    [
        (0, 0, Specialist.PATROL_ONLY),
        (1, 0, Specialist.PICKUP),
        (0, 1, Specialist.HUMANOID),
        (1, 1, Specialist.BALANCED),
        (2, 1, Specialist.BALANCED),  # twice as often is not more than twice
        (2.1, 1, Specialist.PICKUP),
        (3, 1, Specialist.PICKUP),
        (4, 2, Specialist.BALANCED),
        (5, 2, Specialist.PICKUP),
        (1, 2, Specialist.BALANCED),
        (1, 3, Specialist.HUMANOID),
        (2, 4, Specialist.BALANCED),
        (2, 5, Specialist.HUMANOID),
    ],
)
def test_specialist(pickups: float, interactions: float, expected: Specialist) -> None:
    """A specialist does one thing more than twice as often as the other."""
    done = outcome(pickups=pickups, interactions=interactions)
    assert specialist(done, composed().classes) is expected


def test_dominance_ratio() -> None:
    """The ratio is configuration: at 1, one pickup more makes a specialist."""
    strict = composed("classes.dominance_ratio=1").classes
    assert specialist(outcome(pickups=3, interactions=2), strict) is Specialist.PICKUP
    assert specialist(outcome(pickups=2, interactions=2), strict) is Specialist.BALANCED


def test_labels_do_not_depend_on_the_class() -> None:
    """Charging and clearing are labels; a robot that only charges is still patrol-only."""
    done = outcome(charges=1, deliveries=1)
    assert (is_charging(done), is_clearing(done), is_working(done)) == (True, True, False)
    assert specialist(done, composed().classes) is Specialist.PATROL_ONLY


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, ()),
        (EXCELLENT, (Tier.EXCELLENT, Tier.COMPLETE, Tier.FULL_SERVICE)),
        ({**EXCELLENT, "fitness": 30000}, (Tier.COMPLETE, Tier.FULL_SERVICE)),
        ({**EXCELLENT, "pickups": 3}, (Tier.COMPLETE, Tier.FULL_SERVICE)),
        ({**EXCELLENT, "interactions": 1}, (Tier.COMPLETE, Tier.FULL_SERVICE)),
        ({**EXCELLENT, "deliveries": 1}, (Tier.COMPLETE, Tier.FULL_SERVICE)),
        ({**EXCELLENT, "gathered": 5}, (Tier.COMPLETE, Tier.FULL_SERVICE)),
        (COMPLETE, (Tier.COMPLETE, Tier.FULL_SERVICE)),
        ({**COMPLETE, "pickups": 1}, (Tier.FULL_SERVICE,)),
        ({**COMPLETE, "interactions": 0}, ()),
        ({**COMPLETE, "deliveries": 0}, ()),
        ({**COMPLETE, "charges": 0}, ()),
        (FULL_SERVICE, (Tier.FULL_SERVICE,)),
        ({**FULL_SERVICE, "pickups": 0}, ()),
        ({**FULL_SERVICE, "charges": 0}, ()),
        (BALANCED_ELITE, (Tier.BALANCED_ELITE,)),
        ({**BALANCED_ELITE, "gathered": 8}, ()),
        ({**BALANCED_ELITE, "fitness": 15000}, ()),
        ({**EXCELLENT, "gathered": 9}, tuple(Tier)),
    ],
)
def test_table_4(changes: dict[str, Any], expected: tuple[Tier, ...]) -> None:
    """Each row of Table 4, with each of its thresholds met exactly and missed by one."""
    assert tiers(outcome(**changes), composed().classes) == expected


def test_excellent_is_complete() -> None:
    """Table 4's first row asks for no charging, section 2.3.4 does; configuration decides."""
    never_charges = outcome(**{**EXCELLENT, "charges": 0})
    assert tiers(never_charges, composed().classes) == ()
    literal = composed("classes.excellent_is_complete=false").classes
    assert tiers(never_charges, literal) == (Tier.EXCELLENT,)


def test_a_missing_tier_is_refused() -> None:
    """Every tier has a threshold, else nobody could be counted."""
    found = composed().classes.model_dump()
    del found["tiers"]["complete"]
    with pytest.raises(ValidationError, match="missing complete"):
        Classes.model_validate(found)
