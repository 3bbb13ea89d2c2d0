"""Random trees, e.g. of generation 0 and the diversity slots (sections 2.2.3 and 2.3)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import floor, inf, log10
from typing import Annotated, Final

import numpy as np
from pydantic import AfterValidator, BaseModel, Field

from islandgp.bt.analysis.conflicts import without_conflicts
from islandgp.bt.core.arithmetic import Formula, Named, Operation
from islandgp.bt.core.condition import FLAG_OPERATORS, OPERATORS, Condition
from islandgp.bt.core.kind import Argument, Sort
from islandgp.bt.core.kinds import ABORTS, KEYWORDS, KINDS
from islandgp.bt.core.node import Args, GuardArgs, Limits, Node, SetArgs, Value, within
from islandgp.bt.core.parameters import Parameter, leaf_of
from islandgp.bt.core.vocabulary import Key, Vocabulary
from islandgp.domain import total
from islandgp.plain import RISING
from islandgp.seeding import Rng

MAX_EXPECTED_NODES: Final = 2000.0  # most expected nodes of a random tree; a run allows up to 1,000


def weights_of(names: Iterable[str], load: Callable[[str], object] | None = None) -> AfterValidator:
    """Makes pydantic reject weights by which `weighted` cannot draw some of `names`.

    Args:
        names: that may have a weight.
        load: called with a name that has a colon, a path of the user's; None: there are none.
    """

    def checked(weights: dict[str, float]) -> dict[str, float]:
        custom = [name for name in weights if ":" in name and load is not None]
        for name in custom:
            load(name)  # type: ignore[misc] # there are custom names
        choices = [*names, *custom]
        sound = all(name in choices and 0 <= weight < inf for name, weight in weights.items())
        if not sound or sum(weights.values()) <= 0:
            raise ValueError(
                f"expected weights >= 0 for some of {', '.join(choices)}, one of them above 0,"
                f" found {dict(weights)}"
            )
        return weights

    return AfterValidator(checked)


class TreeSettings(BaseModel, frozen=True, extra="forbid"):
    """Settings of random trees."""

    depth: Annotated[tuple[Annotated[int, Field(ge=2)], Annotated[int, Field(le=50)]], RISING]
    """Range of the target depth, in levels."""
    leaf: float = Field(ge=0, le=1)  # probability of an action above the last level
    children: Annotated[tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(le=1000)]], RISING]
    """Least and most children of a composite."""
    repeats: int = Field(ge=1, le=100)  # most repetitions
    kinds: Annotated[dict[str, float], weights_of(KEYWORDS)]  # of each kind but an action
    operators: Annotated[dict[str, float], weights_of(OPERATORS)]  # of comparisons with a number
    aborts: Annotated[dict[str, float], weights_of(ABORTS)]  # of each abort rule

    def faults(self, vocabulary: Vocabulary) -> Iterator[str]:
        """A line if there should be `set`s in a domain without keys that trees write."""
        if self.kinds.get("set") and not vocabulary.initial:
            found = f"found {self.kinds['set']:g}; no key of the domain has an initial value"
            yield f"gp.trees.kinds.set: expected 0, {found}"


@dataclass(frozen=True)
class TreeSpace:
    """The search space of trees: settings of random trees, vocabulary and limits."""

    settings: TreeSettings
    vocabulary: Vocabulary
    limits: Limits

    def repaired(self, tree: Node) -> Node:
        """The tree without branches that would use a resource in the tick of another action."""
        return without_conflicts(tree, self.vocabulary)

    @cached_property
    def actions(self) -> tuple[str, ...]:
        """The names of all actions."""
        return tuple(self.vocabulary.actions)

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """The names of all keys."""
        return tuple(self.vocabulary.keys)

    @cached_property
    def kinds(self) -> dict[str, float]:
        """The weight of each node kind; without keys there is no guard."""
        weights = self.settings.kinds
        if self.keys:
            return weights
        return {k: w for k, w in weights.items() if KINDS[k].args is not GuardArgs}

    @cached_property
    def writable(self) -> tuple[str, ...]:
        """The names of the keys that trees write."""
        return tuple(name for name, key in self.vocabulary.keys.items() if key.writable)


def weighted(rng: Rng, weights: Mapping[str, float]) -> str:
    """A key drawn with probability proportional to its weight."""
    remaining, last = rng.random() * total(weights.values()), ""
    for name, weight in weights.items():
        if weight > 0:
            remaining, last = remaining - weight, name
        if remaining < 0:
            break
    return last


def random_action(rng: Rng, space: TreeSpace) -> Node:
    """A random action, with random arguments."""
    return random_leaf(rng, space.actions[rng.integers(len(space.actions))], space)


def random_leaf(rng: Rng, name: str, space: TreeSpace) -> Node:
    """A leaf of an action, with random arguments if it has parameters."""
    arguments = space.vocabulary.action(name).arguments
    return leaf_of(
        name, {key: random_value(rng, each) for key, each in arguments.items()}, arguments
    )


def random_value(rng: Rng, parameter: Parameter) -> Value:
    """A random value of a parameter: uniform or log-uniform in its range, or one of its words."""
    if parameter.words:
        return parameter.words[rng.integers(len(parameter.words))]
    if parameter.sort == "text":
        return parameter.default
    low, high = parameter.low, parameter.high
    if parameter.logarithmic:
        return rounded(float(np.exp(rng.uniform(np.log(low), np.log(high)))), parameter)
    if parameter.step is None:
        return rounded(float(rng.uniform(low, high)), parameter)
    steps = floor((high - low) / parameter.step + 1e-9)
    return rounded(low + float(rng.integers(steps + 1)) * parameter.step, parameter)


def moved_value(rng: Rng, parameter: Parameter, value: Value, by: float) -> Value:
    """A number moved by a share of its (logarithmic) range, or another one of the words."""
    if not isinstance(value, str):
        return moved_number(parameter, value, by)
    others = [word for word in parameter.words if word != value]
    return others[rng.integers(len(others))] if others else value


def moved_number(parameter: Parameter, value: float, by: float) -> float:
    """A number moved by a share of its range, or of its logarithmic range."""
    low, high = parameter.low, parameter.high
    moved = value * (high / low) ** by if parameter.logarithmic else value + by * (high - low)
    step = 1.0 if parameter.sort == "integer" else parameter.step
    if step is not None and rounded(moved, parameter) == value:
        moved = value + (step if by > 0 else -step)
    return rounded(moved, parameter)


def rounded(value: float, parameter: Parameter) -> float:
    """The nearest value that a parameter can have: in its steps, or in about three digits."""
    if parameter.sort == "integer":
        value = float(round(value))
    elif parameter.step is not None:
        last = floor((parameter.high - parameter.low) / parameter.step + 1e-9)
        steps = min(last, max(0, round((value - parameter.low) / parameter.step)))
        value = round(parameter.low + steps * parameter.step, 9)
    else:
        size = abs(value) if parameter.logarithmic else parameter.high - parameter.low
        digits = 2 - floor(log10(size)) if size > 0 else 0
        value = round(value, min(9, digits if parameter.logarithmic else digits + 1))
    return min(parameter.high, max(parameter.low, value)) + 0.0  # no -0


def random_args(rng: Rng, kind: str, space: TreeSpace) -> Args:
    """The arguments of an inner node."""
    if KINDS[kind].args is GuardArgs:
        name = space.keys[rng.integers(len(space.keys))]
        abort = random_abort(rng, space)
        return GuardArgs(_about(rng, name, space), abort)
    if KINDS[kind].args is SetArgs:
        return SetArgs(random_assignment(rng, space))
    args: Args = KINDS[kind].args(*(_drawn(rng, each, space) for each in KINDS[kind].arguments))
    return args


def random_assignment(rng: Rng, space: TreeSpace) -> Condition:
    """A random value of a random key; for a number also one step more or less than it has."""
    name = space.writable[rng.integers(len(space.writable))]
    key = space.vocabulary.keys[name]
    if key.flag:
        at = int(rng.integers(len(key.choices)))
        return Condition(name, "=", Named(key.choices[at], at))
    if not key.words and rng.random() < 0.5:
        term = Operation("+-"[rng.integers(2)], (name, key.step))
        return Condition(name, "=", 0.0, Formula(term))
    return _about(rng, name, space)._replace(operator="=")


def _drawn(rng: Rng, argument: Argument, space: TreeSpace) -> float | str:
    if argument.sort is Sort.COUNT:
        return float(rng.integers(1, space.settings.repeats + 1))
    if argument.sort is Sort.SECONDS:
        return float(round(10 ** rng.uniform(0, 2)))  # 1 to 100 s
    return list(argument.words)[rng.integers(len(argument.words))]


def random_abort(rng: Rng, space: TreeSpace) -> str:
    """An abort rule, by the weights of the settings."""
    return weighted(rng, space.settings.aborts)


def random_term(rng: Rng, space: TreeSpace) -> Condition:
    """A single condition."""
    return _about(rng, space.keys[rng.integers(len(space.keys))], space)


def _about(rng: Rng, name: str, space: TreeSpace) -> Condition:
    key = space.vocabulary.keys[name]
    if key.flag:
        return Condition(name, FLAG_OPERATORS[rng.integers(len(FLAG_OPERATORS))], 0.0)
    if key.words:
        op = key.operators[rng.integers(len(key.operators))]
        return Condition(name, op, key.number_of(key.words[rng.integers(len(key.words))]))
    op = weighted(rng, space.settings.operators)
    steps = round((key.high - key.low) / key.step)
    return Condition(name, op, on_grid(key, float(rng.integers(steps + 1))))


def on_grid(key: Key, steps: float) -> float:
    """The threshold that is `steps` steps above the least value, rounded to 9 decimals."""
    return round(key.low + steps * key.step, 9) + 0.0  # no -0


def inner_node(rng: Rng, space: TreeSpace, depth: int) -> Node:
    """A random node other than an action, whose tree has at most `depth` >= 2 levels."""
    kind = weighted(rng, space.kinds)
    least, most = space.settings.children
    fewest, limit = KINDS[kind].children
    n = limit
    if fewest < limit:
        n = min(limit, max(fewest, int(rng.integers(least, most + 1))))
    args = random_args(rng, kind, space)
    return Node(kind, args, tuple(grow(rng, space, depth - 1) for _ in range(n)))


def grow(rng: Rng, space: TreeSpace, depth: int) -> Node:
    """A random tree of at most `depth` levels; a branch may end earlier by chance."""
    if depth <= 1 or rng.random() < space.settings.leaf:
        return random_action(rng, space)
    return inner_node(rng, space, depth)


def random_tree(rng: Rng, space: TreeSpace) -> Node:
    """A random tree within the limits; a single action only if the limits allow nothing else."""
    least, most = space.settings.depth
    for _ in range(100):
        depth = min(int(rng.integers(least, most + 1)), space.limits.max_depth)
        if depth < 2:
            break
        tree = space.repaired(inner_node(rng, space, depth))
        if within(tree, space.limits):
            return tree
    return random_action(rng, space)


def expected_nodes(trees: TreeSettings, depth: int) -> float:
    """Expected number of nodes of `grow` with this depth, >= 1; at most MAX_EXPECTED_NODES."""
    weight = sum(trees.kinds.values())
    branching = sum(w for kind, w in trees.kinds.items() if KINDS[kind].children[1] > 1) / weight
    children = 1 - branching + branching * sum(trees.children) / 2
    nodes = 1.0
    for _ in range(1, depth):
        before, nodes = nodes, trees.leaf + (1 - trees.leaf) * (1 + children * nodes)
        if nodes > MAX_EXPECTED_NODES or nodes == before:
            break
    return nodes


def check_growth(
    trees: TreeSettings, limits: Limits, subtree_depth: int, where: str = "gp.mutation"
) -> None:
    """Raises ValueError if creating random trees would take too long.

    Trees that exceed the limits are rejected after their creation, so large ones cost time.
    `where` is the configuration path of the settings with this `subtree_depth`.
    """
    depths = [min(depth, limits.max_depth) for depth in range(trees.depth[0], trees.depth[1] + 1)]
    for key, value in (
        ("gp.trees.depth", sum(expected_nodes(trees, depth) for depth in depths) / len(depths)),
        (f"{where}.subtree_depth", expected_nodes(trees, subtree_depth)),
    ):
        if value > MAX_EXPECTED_NODES:
            raise ValueError(
                f"{key}: expected random trees of at most {MAX_EXPECTED_NODES:,.0f} nodes on"
                " average, found larger ones; lower it or gp.trees.children, or raise gp.trees.leaf"
            )
