"""Constraints: violations, the order of individuals, and the messages for wrong settings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
from pydantic import ValidationError

from islandgp.config.settings import read_settings
from islandgp.domain import Outcome
from islandgp.errors import ConfigError, RunError
from islandgp.evaluation.base import Job
from islandgp.evolution.candidates import Candidate, by_evidence, by_fitness
from islandgp.evolution.validation import validate
from islandgp.gp.plan import Stop
from islandgp.scoring.constraints import (
    Bound,
    in_words,
    merit,
    recorded_constraints,
    running_mean,
    violation,
)
from tests.composed import composed, plain
from tests.samples import CLASSES, outcome
from tests.search.searches import NO_ADVICE, evaluated, search_and_plan

LIMITS = {"charges": Bound(at_least=4), "pickups": Bound(at_most=2)}


@pytest.mark.parametrize(
    ("bound", "value", "expected"),
    [
        (Bound(at_most=3), 3, 0),
        (Bound(at_most=3), 6, 1),
        (Bound(at_most=0), 2, 2),
        (Bound(at_least=4), 4, 0),
        (Bound(at_least=4), 1, 0.75),
        (Bound(at_least=-2), -4, 1),
        (Bound(at_least=1, at_most=3), 2, 0),
        (Bound(at_least=1, at_most=3), 0, 1),
        (Bound(at_least=1, at_most=3), 6, 1),
    ],
)
def test_violations(bound: Bound, value: float, expected: float) -> None:
    """A share of the limit, or a difference where the limit is smaller than 1; 0 inside."""
    assert bound.violation(value) == expected


def test_violations_add_up() -> None:
    """The total counts each limit."""
    assert violation({"charges": 2.0, "pickups": 4.0, "other": 99.0}, LIMITS) == 0.5 + 1.0
    assert violation({"charges": 2.0}, {}) == 0


def test_the_order() -> None:
    """Deb's three rules."""
    order = [merit(5, 0), merit(3, 0), merit(900, 0.5), merit(1, 0.5), merit(999, 2)]
    assert order == sorted(order, reverse=True)


def test_running_mean() -> None:
    """The mean over all evaluations, without their values."""
    means: dict[str, float] = {"charges": 2.0}
    for n, value in ((2, 4.0), (3, 9.0)):
        means = running_mean(means, {"charges": value}, n)
    assert means == {"charges": 5.0}


def test_words() -> None:
    """Limits for people."""
    assert in_words(LIMITS) == "charges at least 4, pickups at most 2"
    assert in_words({}) == ""


@pytest.mark.parametrize(
    ("constraints", "line"),
    [
        ({"pickupz": {"at_most": 3}}, "constraints.pickupz: expected one of pickups"),
        ({"zz9": {"at_most": 3}}, "constraints.zz9: expected one of pickups"),
        ({"pickups": {}}, "constraints.pickups: expected at_least or at_most, found neither"),
        (
            {"pickups": {"at_least": 4, "at_most": 3}},
            "constraints.pickups: expected at_least up to at_most=3, found 4",
        ),
        ({"pickups": {"at_mots": 3}}, "constraints.pickups.at_mots: unknown key;"),
        ({"pickups": {"at_most": "few"}}, "constraints.pickups.at_most='few': input should be"),
        ({"pickups": {"at_most": float("nan")}}, "constraints.pickups.at_most=nan: input should"),
        (
            {"pickups": {"at_most": True}},
            "constraints.pickups.at_most: expected a number, found true",
        ),
        (
            {"pickups": 3},
            "constraints.pickups=3: input should be a valid dictionary or instance of Bound",
        ),
        ([3], "constraints=[3]: input should be a valid dictionary"),
    ],
)
def test_wrong_constraints(constraints: Any, line: str) -> None:
    """One line, with what is expected."""
    with pytest.raises(ConfigError) as error:
        read_settings({**plain(), "constraints": constraints})
    assert str(error.value).startswith(line)
    assert "\n" not in str(error.value)


def test_a_recorded_configuration() -> None:
    """Older runs have none, and a damaged one is reported."""
    assert recorded_constraints({}) == recorded_constraints({"constraints": None}) == {}
    bounds = recorded_constraints({"constraints": {"a": {"at_most": 1, "at_least": None}}})
    assert bounds == {"a": Bound(at_most=1)}
    for damaged in ([1], {"a": {"at_most": "x"}}, "text"):
        with pytest.raises(RunError, match=r"^Expected constraints by counter"):
            recorded_constraints({"constraints": damaged})
    with pytest.raises(ValidationError):
        Bound()


def test_stop_needs_a_feasible_individual() -> None:
    """A target that is reached by breaking a limit is not reached."""
    stop = Stop(fitness=10)
    fit = evaluated("0.0", 50.0)
    assert stop.reason([fit]) == "stop.fitness=10"
    assert stop.reason([replace(fit, violation=0.5), evaluated("0.1", 3.0)]) == ""


def record(generation: int, *individuals: tuple[str, float, float]) -> dict[str, Any]:
    """A generation's record: trees with fitness and pickups."""
    return {
        "snapshot": {"stage": 0, "generation": generation},
        "individuals": [
            {
                "id": f"{generation}.{slot}",
                "tree": tree,
                "fitness": fitness,
                "tiers": [],
                "specialist": "idle",
                "counters": {**dict.fromkeys(composed_counters(), 0.0), "pickups": pickups},
            }
            for slot, (tree, fitness, pickups) in enumerate(individuals)
        ],
    }


def composed_counters() -> list[str]:
    """The island's counters."""
    return list(composed().make_domain().schema.counters)


NO_PICKUPS = {"pickups": Bound(at_most=1)}


def test_candidates_come_feasible_first() -> None:
    """Of each generation's individuals, and by evidence over all generations."""
    records = [
        record(0, ("fit", 90, 8), ("good", 50, 0), ("odd", 70, 3)),
        record(1, ("fit", 95, 8), ("good", 40, 1), ("odd", 70, 0)),
    ]
    assert by_fitness(records, CLASSES, constraints=NO_PICKUPS)[0].tree == "odd"
    assert by_fitness(records, CLASSES)[0].tree == "fit"
    proven = by_evidence(records, constraints=NO_PICKUPS)
    assert [c.tree for c in proven] == ["good", "odd", "fit"]  # odd has 1.5 on average
    assert by_evidence(records)[0].tree == "fit"


def test_a_search_remembers_means() -> None:
    """Racing keeps a tree whose mean keeps the limit, though one evaluation broke it."""
    search, _ = search_and_plan("racing", "constraints={pickups: {at_most: 2}}")
    state = search.start()
    tree = "sequence { SeekCharger ExecuteCharge }"
    for g, pickups in enumerate((0.0, 3.0)):
        population = [
            evaluated(f"{g}.0", 10.0, tree=tree, pickups=pickups),
            evaluated(f"{g}.1", 99.0, pickups=9.0),
        ]
        state = search.tell(state, population, NO_ADVICE)
    assert [e.means["pickups"] for e in state.memory.entries] == [1.5, 9.0]


class Worlds:
    """An evaluator in which the tree `fit` earns most, and picks too much up."""

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        fit, safe = outcome(100.0, pickups=8.0), outcome(50.0)
        return [fit if job.tree == "fit\n" else safe for job in jobs]

    def close(self) -> None:
        """See `Evaluator`."""


def test_validation_chooses_a_feasible_robot() -> None:
    """The race goes by Deb's rules in validation worlds, for any training fitness."""
    pool = [
        Candidate(0, "0.0", "fit\n", trained=100.0),
        Candidate(0, "0.1", "safe\n", trained=50.0, violation=3.0),
    ]
    (winner, verdict), (_, other) = validate(
        pool, range(20), Worlds(), 0, CLASSES, episodes=20, constraints=NO_PICKUPS
    )
    assert winner.tree == "safe\n"
    assert (verdict.violation, verdict.feasible) == (0.0, 1.0)
    assert (other.violation, other.feasible) == (7.0, 0.0)
    ((first, free), _) = validate(pool, range(20), Worlds(), 0, CLASSES, episodes=20)
    assert first.tree == "fit\n"
    assert (free.violation, free.feasible) == (None, None)
