"""Random trees and blackboards of the island that the tests of several packages share."""

from __future__ import annotations

from hypothesis import strategies as st

from islandgp.bt.core.arithmetic import SIGNS, Formula, Operation, Term, bounds, negative
from islandgp.bt.core.condition import (
    OPERATORS,
    Condition,
    ConditionExpr,
    combine,
    comparison,
    negate,
)
from islandgp.bt.core.kinds import ABORTS, ALWAYS, KINDS, NAV2, POLICIES, REPEATS, TIMED, UNLIMITED
from islandgp.bt.core.node import (
    AlwaysArgs,
    CountArgs,
    GuardArgs,
    Node,
    ParallelArgs,
    SecondsArgs,
    leaf,
)
from islandgp.bt.core.node_builder import MAX_NUMBER
from islandgp.domains.island.vocabulary import SCHEMA, VOCABULARY
from islandgp.scoring.generation_stats import GenerationStats
from islandgp.scoring.state import PopulationState
from tests.samples import CLASSES, state

_KEYS = VOCABULARY.keys
_EXACT = frozenset(KINDS) - NAV2 - {"random_selector"}  # kinds with an exact export
_PLAIN = [name for name, kind in KINDS.items() if not kind.arguments]
TURNS = ["inverter", *(name for name in _PLAIN if KINDS[name].decorates)]
COMPOSITES = [name for name in _PLAIN if KINDS[name].children[1] == UNLIMITED]
_FLAGS = [name for name, key in _KEYS.items() if key.flag]
_NUMBERS = [name for name, key in _KEYS.items() if not key.flag]


def numbers() -> st.SearchStrategy[float]:
    """Every threshold that the language allows."""
    integers = st.integers(-MAX_NUMBER, MAX_NUMBER).map(float)
    return integers | st.floats(-MAX_NUMBER, MAX_NUMBER)


def few_numbers() -> st.SearchStrategy[float]:
    """Thresholds that `few_boards` often crosses and often meets exactly."""
    return st.sampled_from([1.0, 2.0, 3.0])


def few_boards() -> st.SearchStrategy[list[float]]:
    """Blackboards with few values, so that conditions change often."""
    number = st.sampled_from([0.0, 1.0, 2.0, 3.0, 4.0])
    flag = st.sampled_from([0.0, 1.0])
    return st.tuples(*(flag if key.flag else number for key in _KEYS.values())).map(list)


def single_conditions(thresholds: st.SearchStrategy[float]) -> st.SearchStrategy[Condition]:
    """Any comparison or flag."""
    operators, flags = st.sampled_from(OPERATORS), st.sampled_from(["is", "not"])
    alone = st.just("")
    return st.builds(Condition, st.sampled_from(_FLAGS), flags, st.just(0.0), alone) | st.builds(
        Condition, st.sampled_from(_NUMBERS), operators, thresholds, alone
    )


def compared_keys() -> st.SearchStrategy[Condition]:
    """Any comparison of two keys that are numbers."""
    operators, keys = st.sampled_from(OPERATORS), st.permutations(_NUMBERS)
    return st.builds(lambda op, names: Condition(names[0], op, 0.0, names[1]), operators, keys)


def sums() -> st.SearchStrategy[Term]:
    """Operations on keys and small numbers."""
    number = st.sampled_from([0.0, 0.1, 0.5, 1.0, 2.0, 3.0])
    leaf: st.SearchStrategy[Term] = st.one_of(number, st.sampled_from(_NUMBERS))

    def operation(part: st.SearchStrategy[Term]) -> st.SearchStrategy[Term]:
        two = st.builds(
            lambda sign, *parts: Operation(sign, parts), st.sampled_from(SIGNS), part, part
        )
        return part.map(negative) | two

    return st.recursive(leaf, operation, max_leaves=5).filter(_divides_well)


def _divides_well(term: Term) -> bool:
    """False if a number in the term is divided by 0, which the language refuses."""
    if not isinstance(term, Operation):
        return True
    return all(map(_divides_well, term.parts)) and not (
        term.sign == "/" and bounds(term.parts[1], {}) == (0, 0)
    )


def calculated() -> st.SearchStrategy[Condition]:
    """Any comparison of sums."""
    keyed = sums().filter(lambda term: isinstance(term, str | Operation) and bool(keys_of(term)))
    return st.builds(comparison, keyed, st.sampled_from(OPERATORS), sums()).filter(
        lambda compared: compared.key != compared.other
    )


def keys_of(term: str | Operation) -> tuple[str, ...]:
    return (term,) if isinstance(term, str) else Formula(term).keys


def conditions(
    thresholds: st.SearchStrategy[float] | None = None, *, pairs: bool = False
) -> st.SearchStrategy[ConditionExpr]:
    """Any condition of one to eight comparisons and flags.

    `pairs`: comparisons of two keys, too, and of sums.
    """
    single = single_conditions(numbers() if thresholds is None else thresholds)
    single = single | compared_keys() | calculated() if pairs else single

    def joined(part: st.SearchStrategy[ConditionExpr]) -> st.SearchStrategy[ConditionExpr]:
        connectives = st.sampled_from(["and", "or"])
        return st.builds(combine, connectives, st.lists(part, min_size=2, max_size=3)) | part.map(
            negate
        )

    return st.one_of(single, st.recursive(single, joined, max_leaves=8))


def when_args(
    thresholds: st.SearchStrategy[float], *, pairs: bool = False
) -> st.SearchStrategy[GuardArgs]:
    """The arguments of any `when`."""
    return st.builds(GuardArgs, conditions(thresholds, pairs=pairs), st.sampled_from([*ABORTS]))


def nodes(
    thresholds: st.SearchStrategy[float] | None = None,
    *,
    max_leaves: int = 12,
    max_repeats: int = REPEATS[1],
    timed: bool = True,
    reactive: bool = True,
    nav2: bool = True,
    if_else: bool = True,
    pairs: bool = False,
    always: bool = True,
) -> st.SearchStrategy[Node]:
    """Valid trees of at most about `max_leaves` leaves, with every kind of node.

    Optional kinds: `timed`, nodes that count seconds; `reactive`, reactive composites; `nav2`,
    Nav2's nodes and others without an exact export; `if_else`; `pairs`, guards that compare two
    keys; `always`, leaves that always end in the same way.
    """
    guard = when_args(numbers() if thresholds is None else thresholds, pairs=pairs)
    policy = st.sampled_from([*POLICIES]) | st.integers(1, 3)
    seconds = st.builds(SecondsArgs, st.sampled_from([0.5, 1.0, 2.0, 2.5]))
    turns, composites, clocks_of = (
        [
            name
            for name in names
            if (nav2 or name in _EXACT) and (reactive or not KINDS[name].reactive)
        ]
        for names in (TURNS, COMPOSITES, TIMED)
    )
    count = st.builds(CountArgs, st.integers(REPEATS[0], max_repeats))

    def inner(child: st.SearchStrategy[Node]) -> st.SearchStrategy[Node]:
        one = st.tuples(child)
        several = st.lists(child, min_size=1, max_size=4).map(tuple)
        composite = st.sampled_from(composites)
        clocks = st.builds(Node, st.sampled_from(clocks_of), seconds, one)
        branching = st.lists(child, min_size=2, max_size=3).map(tuple)
        recovery = st.builds(Node, st.just("recovery"), count, st.tuples(child, child))
        return st.one_of(
            *[clocks] * timed,
            *[recovery] * nav2,
            *[st.builds(Node, st.just("if_else"), st.just(()), branching)] * if_else,
            st.builds(Node, composite, st.just(()), several),
            st.builds(Node, st.just("when"), guard, one),
            st.builds(Node, st.just("parallel"), st.builds(ParallelArgs, policy, policy), several),
            st.builds(Node, st.sampled_from(turns), st.just(()), one),
            st.builds(Node, st.sampled_from(["repeater", "retry"]), count, one),
        )

    action = st.sampled_from(list(VOCABULARY.actions)).map(leaf)
    ends = st.sampled_from([*ALWAYS]).map(lambda word: Node("always", AlwaysArgs(word)))
    leaves = st.one_of(action, action, action, ends) if always else action
    return st.recursive(leaves, inner, max_leaves=max_leaves)


def snapshots(generation: int, population: int = 30) -> st.SearchStrategy[GenerationStats]:
    """Statistics of a generation, with any values that a population can have."""
    count = st.integers(0, population)
    share = st.floats(0, 1)
    points = st.floats(-1e5, 1e6)
    return st.builds(
        GenerationStats,
        generation=st.just(generation),
        epoch=st.just(max(1, -(-generation // 5))),
        stage=st.integers(0, 3),
        fitness_max=points,
        fitness_mean=points,
        fitness_sd=st.floats(0, 1e5),
        diversity=st.floats(0, 0.75),
        working=share,
        specialists=st.fixed_dictionaries(dict.fromkeys(CLASSES.specialist_names, count)),
        behaviour_counts=st.fixed_dictionaries(dict.fromkeys(CLASSES.behaviours, count)),
        tiers=st.fixed_dictionaries(dict.fromkeys(CLASSES.tiers, count)),
        counters=st.fixed_dictionaries(dict.fromkeys(SCHEMA.counters, st.floats(0, 3000))),
        size=st.floats(1, 50),
        rate=share,
    )


@st.composite
def population_states(draw: st.DrawFn, generations: int = 41) -> PopulationState:
    """The state after any history of up to eight generations of a run."""
    last = draw(st.integers(0, generations - 1))
    first = max(0, last - draw(st.integers(0, 7)))
    history = [draw(snapshots(g)) for g in range(first, last + 1)]
    return state(history, generations=generations)
