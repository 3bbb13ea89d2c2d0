"""Classes, labels and tiers of sections 2.3.3 and 2.3.4 at their boundaries."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from islandgp.bt.core.vocabulary import Action, Vocabulary
from islandgp.domain import Counter, Event, Outcome, Schema
from islandgp.scoring.classes import AIMS, Classes, classify, specialist, tiers
from tests.composed import composed
from tests.samples import CLASSES, outcome

EXCELLENT = {
    "pickups": 4, "interactions": 2, "deliveries": 2, "charges": 1, "gathered": 6, "fitness": 30001,
}  # fmt: skip
COMPLETE = {"pickups": 2, "interactions": 1, "deliveries": 1, "charges": 1}
FULL_SERVICE = {"pickups": 1, "interactions": 1, "deliveries": 1, "charges": 1}
BALANCED_ELITE = {"gathered": 9, "fitness": 15001}


@pytest.mark.parametrize(
    ("pickups", "interactions", "expected"),
    [
        (0, 0, "patrol_only"),
        (1, 0, "pickup"),
        (0, 1, "humanoid"),
        (1, 1, "balanced"),
        (2, 1, "balanced"),  # twice as often is not more than twice
        (2.1, 1, "pickup"),
        (3, 1, "pickup"),
        (4, 2, "balanced"),
        (5, 2, "pickup"),
        (1, 2, "balanced"),
        (1, 3, "humanoid"),
        (2, 4, "balanced"),
        (2, 5, "humanoid"),
    ],
)
def test_specialist(pickups: float, interactions: float, expected: str) -> None:
    """A specialist does one thing more than twice as often as the other."""
    result = outcome(pickups=pickups, interactions=interactions)
    assert specialist(result, CLASSES) == expected


def test_dominance_ratio() -> None:
    """The ratio is configuration: at 1, one pickup more makes a specialist."""
    strict = composed("classes.specialists.dominance_ratio=1").classes
    assert specialist(outcome(pickups=3, interactions=2), strict) == "pickup"
    assert specialist(outcome(pickups=2, interactions=2), strict) == "balanced"


def row(also: str | None = None, **least: float) -> dict[str, Any]:
    """A tier's row."""
    return {"at_least": least, "also": also}


def test_a_tier_needs_all_that_those_need_which_it_needs() -> None:
    """`also` holds through any number of tiers."""
    tiers_of = {"a": row("b", distance=0), "b": row("c", distance=0), "c": row(pickups=3)}
    chain = Classes.model_validate({**CLASSES.model_dump(), "tiers": tiers_of, "milestones": ["a"]})
    assert tiers(outcome(pickups=2), chain) == ()
    assert tiers(outcome(pickups=3), chain) == ("a", "b", "c")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tiers": {"a": row("a")}, "milestones": ["a"]}, "expected an end, found a needs a"),
        (
            {"tiers": {"a": row("b"), "b": row("a")}, "milestones": ["a"]},
            "tiers.a.also: expected an end, found a needs b needs a",
        ),
        ({"milestones": ["complete", "complete"]}, "milestones: expected each name once, found"),
        (
            {"specialists": {**CLASSES.specialists.model_dump(), "of": ["pickup", "pickup"]}},
            "specialists.of: expected each name once, found pickup, pickup",
        ),
    ],
)
def test_circles_and_names_given_twice_are_refused(changes: dict[str, Any], message: str) -> None:
    """Such classes would have no members, or wrong ones."""
    with pytest.raises(ValidationError, match=message):
        Classes.model_validate({**CLASSES.model_dump(), **changes})


def test_labels_do_not_depend_on_the_class() -> None:
    """Charging and clearing are labels; a robot that only charges is still patrol-only."""
    result = outcome(charges=1, deliveries=1)
    labels = classify(result, CLASSES)
    assert (labels.specialist, labels.behaviours) == ("patrol_only", ("charging", "clearing"))
    assert not labels.working


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, ()),
        (EXCELLENT, ("excellent", "complete", "full_service")),
        ({**EXCELLENT, "fitness": 30000}, ("complete", "full_service")),
        ({**EXCELLENT, "pickups": 3}, ("complete", "full_service")),
        ({**EXCELLENT, "interactions": 1}, ("complete", "full_service")),
        ({**EXCELLENT, "deliveries": 1}, ("complete", "full_service")),
        ({**EXCELLENT, "gathered": 5}, ("complete", "full_service")),
        (COMPLETE, ("complete", "full_service")),
        ({**COMPLETE, "pickups": 1}, ("full_service",)),
        ({**COMPLETE, "interactions": 0}, ()),
        ({**COMPLETE, "deliveries": 0}, ()),
        ({**COMPLETE, "charges": 0}, ()),
        (FULL_SERVICE, ("full_service",)),
        ({**FULL_SERVICE, "pickups": 0}, ()),
        ({**FULL_SERVICE, "charges": 0}, ()),
        (BALANCED_ELITE, ("balanced_elite",)),
        ({**BALANCED_ELITE, "gathered": 8}, ()),
        ({**BALANCED_ELITE, "fitness": 15000}, ()),
        ({**EXCELLENT, "gathered": 9}, tuple(CLASSES.tiers)),
    ],
)
def test_table_4(changes: dict[str, Any], expected: tuple[str, ...]) -> None:
    """Each row of Table 4, with each of its thresholds met exactly and missed by one."""
    assert tiers(outcome(**changes), CLASSES) == expected


def test_excellent_is_complete() -> None:
    """Table 4's first row asks for no charging, section 2.3.4 does; configuration decides."""
    never_charges = outcome(**{**EXCELLENT, "charges": 0})
    assert tiers(never_charges, CLASSES) == ()
    literal = composed("classes.tiers.excellent.also=null").classes
    assert tiers(never_charges, literal) == ("excellent",)


def test_the_names_of_the_paper() -> None:
    """Classes, labels and targets in the order in which records and tables have them."""
    assert CLASSES.specialist_names == ("patrol_only", "pickup", "humanoid", "balanced")
    assert CLASSES.elite_behaviours == ("pickup", "humanoid", "balanced", "charging", "clearing")
    assert CLASSES.targets == ("pickup", "humanoid", "charging", "clearing", *AIMS)
    assert CLASSES.milestones == ("complete", "excellent")


@pytest.mark.parametrize(
    ("counts", "behaviours", "performed"),
    [
        ({}, (), ()),
        ({"charges": 1}, ("charging",), ("charging",)),
        ({"interactions": 1}, ("humanoid",), ("humanoid",)),
        (
            {"pickups": 3, "interactions": 1, "deliveries": 0.2},
            ("pickup", "clearing"),
            ("pickup", "humanoid", "clearing"),
        ),
        (
            {"pickups": 2, "interactions": 2, "charges": 1, "deliveries": 1},
            ("balanced", "charging", "clearing"),
            ("pickup", "humanoid", "charging", "clearing"),
        ),
    ],
)
def test_behaviours(
    counts: dict[str, Any], behaviours: tuple[str, ...], performed: tuple[str, ...]
) -> None:
    """The labels name the class, unless it is idle, and the labels; `shown` all behaviours."""
    assert classify(outcome(**counts), CLASSES).behaviours == behaviours
    assert CLASSES.behaviours_of(outcome(**counts).counters) == performed


# Other domains

SCHEMA = Schema(
    vocabulary=Vocabulary("collector", {"Walk": Action("")}, {}),
    components={"points": ""},
    events={"step": Event("")},
    counters=dict.fromkeys(("reds", "greens", "blues", "steps"), Counter("")),
    task="",
)


def colours(*of: str, ratio: float = 2, **changes: Any) -> Classes:
    """Classes of a robot that collects things of three colours."""
    plain = {
        "behaviours": {"red": "reds", "green": "greens", "blue": "blues", "walking": "steps"},
        "specialists": {"of": of, "dominance_ratio": ratio, "idle": "lazy", "mixed": "mixed"},
        "tiers": {"good": {"at_least": {"reds": 1}}},
        "milestones": ["good"],
    }
    return Classes.model_validate({**plain, **changes})


def colour_outcome(
    reds: float = 0, greens: float = 0, blues: float = 0, steps: float = 0
) -> Outcome:
    """What such a robot did."""
    counters = {"reds": reds, "greens": greens, "blues": blues, "steps": steps}
    return Outcome({"points": 10.0}, counters, 1.0, ("time",))


@pytest.mark.parametrize(("reds", "expected"), [(0, "lazy"), (0.5, "red"), (9, "red")])
def test_one_behaviour_alone(reds: float, expected: str) -> None:
    """With one behaviour, each robot that shows it is its specialist; none is mixed."""
    labels = classify(colour_outcome(reds=reds, greens=9), colours("red"))
    assert labels.specialist == expected
    assert labels.working == (expected == "red")
    assert labels.behaviours == (*(("red",) if reds else ()), "green")


@pytest.mark.parametrize(
    ("counts", "expected"),
    [
        ((0, 0, 0), "lazy"),
        ((1, 0, 0), "red"),
        ((0, 0, 1), "blue"),
        ((5, 2, 2), "red"),  # more than twice as often as each other, not as all of them
        ((4, 2, 1), "mixed"),
        ((1, 2, 5), "blue"),
        ((2, 2, 0), "mixed"),
        ((0, 5, 5), "mixed"),
        ((1, 1, 1), "mixed"),
    ],
)
def test_three_compete(counts: tuple[float, float, float], expected: str) -> None:
    """A specialist does one thing more than twice as often as any other."""
    assert specialist(colour_outcome(*counts), colours("red", "green", "blue")) == expected


@pytest.mark.parametrize(
    ("counts", "expected"), [((3, 2, 2), "red"), ((3, 3, 2), "mixed"), ((0, 0, 0.1), "blue")]
)
def test_ratio_1(counts: tuple[float, float, float], expected: str) -> None:
    """At ratio 1 the most frequent behaviour is the class; a tie is mixed."""
    assert specialist(colour_outcome(*counts), colours("red", "green", "blue", ratio=1)) == expected


def test_tiers_of_other_counters() -> None:
    """`at_least` is met by equality, `above` is not; `also` asks for another tier as well."""
    tiers_of = {
        "best": {"above": {"fitness": 9.9}, "also": "good"},
        "good": {"at_least": {"reds": 2}, "above": {"steps": 3}},
        "any": {},
    }
    classes = colours("red", tiers=tiers_of)
    assert tiers(colour_outcome(reds=2, steps=3.5), classes) == ("best", "good", "any")
    assert tiers(colour_outcome(reds=2, steps=3), classes) == ("any",)
    assert tiers(colour_outcome(reds=1.9, steps=9), classes) == ("any",)
    strict = {**tiers_of, "best": {"above": {"fitness": 10}, "also": "good"}}
    assert tiers(colour_outcome(reds=2, steps=4), colours("red", tiers=strict)) == ("good", "any")


def test_a_tier_with_an_upper_bound() -> None:
    """`at_most` is met by equality; below a lower bound of the same counter it is refused."""
    classes = colours("red", tiers={"good": {"at_least": {"reds": 1}, "at_most": {"steps": 3}}})
    assert tiers(colour_outcome(reds=1, steps=3), classes) == ("good",)
    assert tiers(colour_outcome(reds=1, steps=3.5), classes) == ()
    with pytest.raises(ValidationError, match="steps: expected bounds up to at_most=3, found 4"):
        colours("red", tiers={"good": {"above": {"steps": 4}, "at_most": {"steps": 3}}})


def test_also_may_name_a_tier_further_up() -> None:
    """The order of tiers is only the order in which they are reported."""
    classes = colours("red", tiers={"good": {"at_least": {"reds": 2}}, "kind": {"also": "good"}})
    assert tiers(colour_outcome(reds=2), classes) == ("good", "kind")
    assert tiers(colour_outcome(reds=1), classes) == ()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"milestones": ["best"]}, "milestones: expected one of good, found 'best'"),
        ({"milestones": []}, "milestones"),
        ({"tiers": {}}, "tiers"),
        ({"behaviours": {}}, "behaviours"),
        (
            {"tiers": {"good": {"also": "best"}}},
            "tiers.good.also: expected one of good, found 'best'",
        ),
        ({"tiers": {"good": {"above": {"reds": float("nan")}}}}, "finite"),
        ({"behaviours": {"red": "reds", "rare": "reds"}}, "expected each name once.*'rare' twice"),
        ({"behaviours": {"red": "reds", "lazy": "reds"}}, "expected each name once.*'lazy' twice"),
        ({"behaviours": {"Red": "reds"}}, "pattern"),
        ({"colour": 1}, "not permitted"),
    ],
)
def test_classes_that_do_not_fit_together(changes: dict[str, Any], message: str) -> None:
    """A name of nothing, or of two things, is refused."""
    with pytest.raises(ValidationError, match=message):
        colours("red", **changes)


@pytest.mark.parametrize(
    ("of", "ratio", "message"),
    [
        (("pink",), 2, "specialists.of: expected one of red, green, blue, walking, found 'pink'"),
        ((), 2, "specialists.of"),
        (("red",), 0.9, "dominance_ratio"),
    ],
)
def test_specialists_that_cannot_be(of: tuple[str, ...], ratio: float, message: str) -> None:
    """What competes are behaviours, and to dominate is not to be second."""
    with pytest.raises(ValidationError, match=message):
        colours(*of, ratio=ratio)


def test_unknown_counters_are_reported_with_their_path() -> None:
    """Which counters there are is the domain's: each wrong name is a line."""
    classes = colours(
        "red",
        behaviours={"red": "reds", "far": "metres"},
        tiers={
            "good": {"at_least": {"reds": 1, "fun": 2}, "above": {"fitness": 3}},
            "best": {"above": {"joy": 1}, "at_most": {"sun": 1}},
        },
    )
    counters = "reds, greens, blues, steps"
    assert list(classes.faults(SCHEMA)) == [
        f"classes.behaviours.far: expected one of {counters}, found 'metres'",
        f"classes.tiers.good.at_least.fun: expected one of {counters}, fitness, found 'fun'",
        f"classes.tiers.best.above.joy: expected one of {counters}, fitness, found 'joy'",
        f"classes.tiers.best.at_most.sun: expected one of {counters}, fitness, found 'sun'",
    ]
    assert list(colours("red").faults(SCHEMA)) == []
