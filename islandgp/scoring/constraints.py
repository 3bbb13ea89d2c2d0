"""Constraints: limits on counters, and the ranking of individuals by violation and fitness.

The rules of Deb 2000, "An efficient constraint handling method for genetic algorithms", doi
10.1016/S0045-7825(99)00389-8: a feasible individual is better than an infeasible one; of two
infeasible ones, the one with the smaller total violation is better; of two feasible ones, the one
with the higher fitness.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final, Self, TypeAlias

from pydantic import BaseModel, Field, FiniteFloat, ValidationError, model_validator

from islandgp.domain import Outcome, Schema, total
from islandgp.domain.rewards import unknown
from islandgp.errors import RunError, brief


class Bound(BaseModel, frozen=True, extra="forbid"):
    """Limits of a counter's mean over an individual's episodes."""

    at_least: FiniteFloat | None = Field(None)  # in the counter's unit; None: any
    at_most: FiniteFloat | None = Field(None)  # in the counter's unit; None: any

    @model_validator(mode="after")
    def _not_empty(self) -> Self:
        low, high = self.at_least, self.at_most
        if low is None and high is None:
            raise ValueError("expected at_least or at_most, found neither; give one")
        if low is not None and high is not None and low > high:
            raise ValueError(f"expected at_least up to at_most={high:g}, found {low:g}")
        return self

    def violation(self, value: float) -> float:
        """The distance of a value from the limits, relative to the limit (at least to 1)."""
        if self.at_least is not None and value < self.at_least:
            return (self.at_least - value) / max(1.0, abs(self.at_least))
        if self.at_most is not None and value > self.at_most:
            return (value - self.at_most) / max(1.0, abs(self.at_most))
        return 0.0


Constraints: TypeAlias = Mapping[str, Bound]  # limits by counter of the domain; {} for none

NO_CONSTRAINTS: Final[Constraints] = MappingProxyType({})

Merit: TypeAlias = tuple[float, float]
"""Sort key: (minus the violation, fitness); greater is better."""


def violation(counters: Mapping[str, float], constraints: Constraints) -> float:
    """The sum of the violations of all limits, >= 0; 0 if all are kept."""
    if not constraints:
        return 0.0
    return float(total(bound.violation(counters[name]) for name, bound in constraints.items()))


def merit(fitness: float, violation: float) -> Merit:
    """The sort key of an individual with this fitness and violation."""
    return -violation, fitness


def limited(counters: Mapping[str, float], constraints: Constraints) -> dict[str, float]:
    """The counters that have limits."""
    return {name: counters[name] for name in constraints}


def running_mean(before: Mapping[str, float], now: Mapping[str, float], n: int) -> dict[str, float]:
    """The means of counters over `n` evaluations, from those over n - 1 and the last values."""
    return {name: before[name] + (value - before[name]) / n for name, value in now.items()}


def mean_violation(outcomes: Sequence[Outcome], constraints: Constraints) -> float:
    """The violation of the counters' means over at least one outcome."""
    n = len(outcomes)
    means = {name: total(o.counters[name] for o in outcomes) / n for name in constraints}
    return violation(means, constraints)


def feasible_share(outcomes: Sequence[Mapping[str, float]], constraints: Constraints) -> float:
    """The share of outcomes that keep all limits, in [0, 1]; there must be an outcome."""
    return sum(not violation(counters, constraints) for counters in outcomes) / len(outcomes)


def in_words(constraints: Constraints) -> str:
    """The limits as text, e.g. "collisions at most 3"."""
    return ", ".join(
        f"{name} {word} {limit:g}"
        for name, bound in constraints.items()
        for word, limit in (("at least", bound.at_least), ("at most", bound.at_most))
        if limit is not None
    )


def faults(constraints: Constraints, schema: Schema) -> Iterator[str]:
    """A line for each counter that the domain does not declare."""
    for name in constraints:
        yield from unknown(f"constraints.{name}", name, schema.counters)


def recorded_constraints(config: Mapping[str, Any]) -> Constraints:
    """The constraints in a run's configuration. Raises RunError if they are damaged."""
    try:
        limits = dict(config.get("constraints") or {})
        return {str(name): Bound.model_validate(bound) for name, bound in limits.items()}
    except (ValidationError, ValueError, TypeError) as error:
        raise RunError(
            "Expected constraints by counter in the configuration of a run, found a damaged one"
            f" ({brief(error)}); run its command again under another name."
        ) from error
