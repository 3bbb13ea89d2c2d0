"""What a tree does, tick by tick: one test for each row of the table in docs/semantics.md."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from islandgp.bt.core.condition import FLAG_OPERATORS, OPERATORS, Condition
from islandgp.bt.core.engine import ABORTED, compile_tree, condition, ticks_of
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import AGAIN, FAILURE, RUNNING, SUCCESS, guard_of, thresholds
from islandgp.domains.island.vocabulary import VOCABULARY
from tests.bt import test_set
from tests.bt.stage import Stage, short_tree

PLACES = VOCABULARY.key_index
DOCS = Path(__file__).parents[2] / "docs"


# Root and actions


def test_root_restarts() -> None:
    """A finished root starts again in the next tick, with fresh leaves."""
    stage = Stage("sequence { A B }", A="S", B="RSR")
    assert stage.tick() == ("A! B!", RUNNING)
    assert stage.tick() == ("B", SUCCESS)
    assert stage.tick() == ("A! B!", RUNNING)


def test_action_fresh() -> None:
    """An action gets fresh=True when it starts and fresh=False while it continues."""
    stage = Stage("A", A="RRFRS")
    assert [stage.tick() for _ in range(5)] == [
        ("A!", RUNNING),
        ("A", RUNNING),
        ("A", FAILURE),
        ("A!", RUNNING),
        ("A", SUCCESS),
    ]


def test_snapshot() -> None:
    """The blackboard is read, never copied: a change between ticks counts on the next one."""
    board = [0.0] * 5
    tick = compile_tree(
        short_tree("when p { A }"), {"MoveToGarbage": lambda _: RUNNING}, board, PLACES
    )
    assert tick() == FAILURE
    board[3] = 1.0
    assert tick() == RUNNING


# Selector and sequence


def test_selector_stops_at_success() -> None:
    """A selector succeeds with its first child that does; later ones are not ticked."""
    assert Stage("selector { A B C }", A="F", B="S").tick() == ("A! B!", SUCCESS)


def test_selector_fails_when_all_fail() -> None:
    """A selector fails when no child is left."""
    assert Stage("selector { A B }", A="F", B="F").tick() == ("A! B!", FAILURE)


def test_sequence_stops_at_failure() -> None:
    """A sequence fails with its first child that does; later ones are not ticked."""
    assert Stage("sequence { A B C }", A="S", B="F").tick() == ("A! B!", FAILURE)


def test_sequence_succeeds_when_all_succeed() -> None:
    """A sequence succeeds when no child is left."""
    assert Stage("sequence { A B }", A="S", B="S").tick() == ("A! B!", SUCCESS)


@pytest.mark.parametrize(("kind", "first"), [("selector", "F"), ("sequence", "S")])
def test_composite_memory(kind: str, first: str) -> None:
    """A running child is resumed; the children before it are not ticked again."""
    stage = Stage(f"{kind} {{ A B C }}", A=first, B="R" + first)
    assert stage.tick() == ("A! B!", RUNNING)
    assert stage.tick() == ("B C!", RUNNING)
    assert stage.tick() == ("C", RUNNING)


# Parallel


def test_parallel_ticks_unfinished_in_order() -> None:
    """Each tick goes to every child that is not finished, in document order."""
    stage = Stage("parallel { A B C }", B="S")
    assert stage.tick() == ("A! B! C!", RUNNING)
    assert stage.tick() == ("A C", RUNNING)


def test_parallel_judges_afterwards() -> None:
    """Children behind the one that decides are ticked as well."""
    assert Stage("parallel { A B C }", A="F", C="F").tick() == ("A! B! C!", FAILURE)


def test_parallel_failures_first() -> None:
    """When both enough children failed and enough succeeded, it fails."""
    assert Stage("parallel success one { A B }", A="S", B="F").tick()[1] == FAILURE


@pytest.mark.parametrize(
    ("policies", "a", "b", "expected"),
    [
        ("", "S", "S", SUCCESS),
        ("", "S", "R", RUNNING),
        ("", "R", "F", FAILURE),
        ("success one", "R", "S", SUCCESS),
        ("failure all", "R", "F", RUNNING),
        ("failure all", "F", "F", FAILURE),
        ("success one failure all", "S", "F", SUCCESS),
    ],
)
def test_parallel_policies(policies: str, a: str, b: str, expected: int) -> None:
    """`success` and `failure` set whether one child decides, or all; default: all and one."""
    assert Stage(f"parallel {policies} {{ A B }}", A=a, B=b).tick()[1] == expected


def test_parallel_mixed_results_fail() -> None:
    """When every child is finished and neither count is met, it fails."""
    assert Stage("parallel failure all { A B }", A="S", B="F").tick()[1] == FAILURE


def test_parallel_end_aborts() -> None:
    """When it ends, children that still run are aborted, and start fresh the next time."""
    stage = Stage("parallel { sequence { A B } C }", A="S", C="RF")
    assert stage.tick() == ("A! B! C!", RUNNING)
    assert stage.tick() == ("B C", FAILURE)
    assert (3, ABORTED) in stage.events
    assert stage.tick() == ("A! B! C!", FAILURE)


# Inverter and repeater


@pytest.mark.parametrize(("child", "expected"), [("S", FAILURE), ("F", SUCCESS), ("R", RUNNING)])
def test_inverter(child: str, expected: int) -> None:
    """Success becomes failure and failure success; running stays."""
    assert Stage("inverter { A }", A=child).tick()[1] == expected


def test_repeater_one_a_tick() -> None:
    """One repetition  a tick; between two of them the status is AGAIN."""
    stage = Stage("repeater 3 { A }", A="SRSS")
    assert stage.tick() == ("A!", AGAIN)
    assert stage.tick() == ("A!", RUNNING)
    assert stage.tick() == ("A", AGAIN)
    assert stage.tick() == ("A!", SUCCESS)


def test_retry_one_a_tick() -> None:
    """One try  a tick; between two of them the status is AGAIN."""
    stage = Stage("retry 3 { A }", A="FRFF")
    assert stage.tick() == ("A!", AGAIN)
    assert stage.tick() == ("A!", RUNNING)
    assert stage.tick() == ("A", AGAIN)
    assert stage.tick() == ("A!", FAILURE)


def test_retry_succeeds_with_its_child() -> None:
    """One success of the child ends it, and the count starts from zero the next time."""
    stage = Stage("retry 2 { A }", A="FSFF")
    statuses = [stage.tick()[1] for _ in range(4)]
    assert statuses == [AGAIN, SUCCESS, AGAIN, FAILURE]


def test_forced_ends() -> None:
    """However the child ends, the status is the forced one; while it runs, it runs."""
    for word, end in (("force_success", SUCCESS), ("force_failure", FAILURE)):
        stage = Stage(f"{word} {{ A }}", A="RFRSF")
        assert [stage.tick()[1] for _ in range(5)] == [RUNNING, end, RUNNING, end, end]


@pytest.mark.parametrize("policy", ["success 2", "success 2 failure 2"])
def test_parallel_counts(policy: str) -> None:
    """A number sets how many children decide; it is never more than there are."""
    assert Stage(f"parallel {policy} {{ A B C }}", A="S", B="S").tick()[1] == SUCCESS
    failed = Stage(f"parallel {policy} {{ A B C }}", A="F").tick()[1]
    assert failed == (RUNNING if "failure 2" in policy else FAILURE)
    assert Stage("parallel success 9 failure 9 { A }", A="S").tick()[1] == SUCCESS


@pytest.mark.parametrize(("kind", "ends"), [("reactive_selector", "F"), ("reactive_sequence", "S")])
def test_reactive_begins_with_its_first_child(kind: str, ends: str) -> None:
    """Children that ended start again in each tick; the running one is resumed."""
    stage = Stage(f"{kind} {{ A B }}", A=ends)
    assert stage.tick() == ("A! B!", AGAIN)
    assert stage.tick() == ("A! B", AGAIN)


def test_reactive_aborts_later_children() -> None:
    """A child that does not hand over stops the later one, after its own tick."""
    stage = Stage("reactive_selector { A B }", A="FRF")
    assert stage.tick() == ("A! B!", AGAIN)
    assert stage.tick() == ("A!", RUNNING)
    assert stage.events == [(1, RUNNING), (2, ABORTED), (0, RUNNING)]
    assert stage.tick() == ("A B!", AGAIN)


def test_reactive_observes_no_guard() -> None:
    """Its children are asked in each tick anyway; `lower` does nothing there."""
    stage = Stage("selector { reactive_sequence { when p abort lower { A } B } C }", A="S", B="F")
    assert stage.tick() == ("C!", RUNNING)
    assert stage.tick(p=1) == ("C", RUNNING)


def test_wait() -> None:
    """Its child starts in the first tick that is at least so late."""
    stage = Stage("wait 1.5 { A }", A="RS")
    ticks = [stage.tick() for _ in range(5)]
    assert ticks == [("", AGAIN), ("", AGAIN), ("A!", RUNNING), ("A", SUCCESS), ("", AGAIN)]


def test_timeout() -> None:
    """In the first tick that is at least so late its child is aborted, and it fails."""
    stage = Stage("timeout 2 { A }")
    assert [stage.tick() for _ in range(3)] == [("A!", AGAIN), ("A", AGAIN), ("", FAILURE)]
    assert stage.events == [(1, ABORTED), (0, FAILURE)]
    assert stage.tick() == ("A!", AGAIN)


def test_cooldown() -> None:
    """Its child starts again in the first tick that is at least so late after its end."""
    stage = Stage("selector { cooldown 2 { A } B }", A="S", B="S")
    assert [stage.tick()[0] for _ in range(5)] == ["A!", "B!", "A!", "B!", "A!"]
    stage = Stage("when p { cooldown 2 { A } }", "p", A="R")
    assert [stage.tick(p=p)[0] for p in (1, 0, 1)] == ["A!", "", "A!"]  # an abort is no end


def test_every() -> None:
    """After a success its child starts so much later; after a failure or an abort at once."""
    stage = Stage("every 3 { A }", A="SRSFS")
    calls = [stage.tick() for _ in range(9)]
    assert [c for c, _ in calls] == ["A!", "", "", "A!", "A", "", "", "A!", "A!"]
    assert [s for _, s in calls[:3]] == [SUCCESS, AGAIN, AGAIN]
    stage = Stage("when p { every 9 { A } }", "p", A="S")
    assert [stage.tick(p=p)[0] for p in (1, 1, 0, 1)] == ["A!", "", "", "A!"]


def test_until_failure() -> None:
    """It repeats its child, one repetition a tick, until that fails."""
    stage = Stage("until_failure { A }", A="SRSF")
    assert [stage.tick() for _ in range(4)] == [
        ("A!", AGAIN), ("A!", RUNNING), ("A", AGAIN), ("A!", FAILURE)
    ]  # fmt: skip


def test_until_success() -> None:
    """It repeats its child, one repetition a tick, until that succeeds."""
    stage = Stage("until_success { A }", A="FRFS")
    assert [stage.tick() for _ in range(4)] == [
        ("A!", AGAIN), ("A!", RUNNING), ("A", AGAIN), ("A!", SUCCESS)
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("word", "status"), [("success", SUCCESS), ("failure", FAILURE), ("running", AGAIN)]
)
def test_always(word: str, status: int) -> None:
    """It has its status in each tick, also beside a child that runs."""
    assert [Stage(f"always {word}").tick() for _ in range(2)] == [("", status)] * 2
    stage = Stage(f"selector {{ always {word} A }}", A="R")
    assert stage.tick() == (("A!", RUNNING) if word == "failure" else ("", status))


def test_pipeline_repeats_earlier_children() -> None:
    """Children that ended start again before the running one is resumed."""
    stage = Stage("pipeline { A B }", A="S", B="RS")
    assert [stage.tick() for _ in range(2)] == [("A! B!", AGAIN), ("A! B", SUCCESS)]
    assert Stage("pipeline { A B C }", A="S", B="F").tick() == ("A! B!", FAILURE)


def test_pipeline_passes_running_children() -> None:
    """A running child ends the tick only if no later child was reached before."""
    stage = Stage("pipeline { A B }", A="RSRRS", B="R")
    assert [stage.tick()[0] for _ in range(4)] == ["A!", "A B!", "A! B", "A B"]


def test_pipeline_end_aborts() -> None:
    """When it fails or succeeds, children that still run are aborted."""
    stage = Stage("pipeline { A B }", A="SR", B="RS")
    assert [stage.tick()[1] for _ in range(2)] == [AGAIN, SUCCESS]
    assert stage.events == [(1, RUNNING), (2, SUCCESS), (1, ABORTED), (0, SUCCESS)]
    assert stage.tick()[0] == "A!"


def test_round_robin() -> None:
    """It begins behind the child that succeeded last, and at the first one when all failed."""
    stage = Stage("round_robin { A B C }", A="SF", B="FSF", C="SF")
    assert [stage.tick() for _ in range(5)] == [
        ("A!", SUCCESS), ("B! C!", SUCCESS), ("A! B!", SUCCESS), ("C! A! B!", FAILURE),
        ("A! B! C!", FAILURE),
    ]  # fmt: skip


def test_round_robin_aborted() -> None:
    """An abort while it runs sets it back to its first child."""
    stage = Stage("when p { round_robin { A B } }", "p", A="S", B="R")
    assert [stage.tick(p=p)[0] for p in (1, 1, 0, 1)] == ["A!", "B!", "", "A!"]


def test_random_selector() -> None:
    """It tries its children in another order at each start; a seed gives the same orders."""
    orders = []
    for _ in range(2):
        stage = Stage("random_selector { A B C }", A="F", B="F", C="F")
        orders.append([stage.tick() for _ in range(12)])
    assert orders[0] == orders[1]
    assert {status for _, status in orders[0]} == {FAILURE}
    assert {"".join(sorted(calls)) for calls, _ in orders[0]} == {"  !!!ABC"}
    assert len({calls for calls, _ in orders[0]}) > 3
    stage = Stage("random_selector { A B }", A="RS", B="RS")
    first, then = stage.tick()[0], stage.tick()[0]
    assert f"{then}!" == first


def test_if_else() -> None:
    """The first child chooses between the two others, from the tick in which it ends."""
    stage = Stage("if_else { A B C }", A="RSF", B="RF", C="S")
    assert [stage.tick() for _ in range(4)] == [
        ("A!", RUNNING), ("A B!", RUNNING), ("B", FAILURE), ("A! C!", SUCCESS)
    ]  # fmt: skip
    assert Stage("if_else { A B }", A="F").tick() == ("A!", FAILURE)


def test_counts_and_seconds_from_keys() -> None:
    """A key is read at the start of a repetition or of a time; below 1 there is no repetition."""
    stage = Stage("retry n { A }", A="F")
    assert [stage.tick(n=n) for n in (2, 9, 0, 1)] == [
        ("A!", AGAIN), ("A!", FAILURE), ("", FAILURE), ("A!", FAILURE)
    ]  # fmt: skip
    assert Stage("repeater n { A }", A="S").tick(n=-3) == ("", SUCCESS)
    for word, calls in (("wait", ["", "", "A!"]), ("timeout", ["A!", "A", ""])):
        stage = Stage(f"{word} x {{ A }}")
        assert [stage.tick(x=x)[0] for x in (1.5, 50, 0)] == calls


def test_recovery() -> None:
    """After a failure of its first child comes the second, then the first again, in one tick."""
    stage = Stage("recovery 2 { A B }", A="RFRS", B="RS")
    assert [stage.tick() for _ in range(4)] == [
        ("A!", RUNNING), ("A B!", RUNNING), ("B A!", RUNNING), ("A", SUCCESS)
    ]  # fmt: skip


def test_recovery_fails() -> None:
    """It fails with the second child, and after as many recoveries as it has."""
    assert Stage("recovery 2 { A B }", A="F", B="F").tick() == ("A! B!", FAILURE)
    assert Stage("recovery 2 { A B }", A="F", B="S").tick() == ("A! B! A! B! A!", FAILURE)


@pytest.mark.parametrize("head", ["pipeline", "round_robin", "recovery 1"])
def test_nav2_composites_observe_no_guard(head: str) -> None:
    """A guard that becomes true below one of them stops no later branch."""
    stage = Stage(f"selector {{ {head} {{ when p abort lower {{ A }} B }} C }}", A="S", B="F")
    stage.tick()
    assert stage.tick(p=1)[0] == "C"


def test_seconds_are_whole_ticks() -> None:
    """As many ticks as reach the time: 1.1 s are eleven of 0.1 s, without rounding errors."""
    assert [ticks_of(s, 0.1) for s in (0.01, 0.3, 1.1, 1.11)] == [1, 3, 11, 12]


def test_repeater_fails_with_its_child() -> None:
    """One failure of the child fails it, and the count starts from zero the next time."""
    stage = Stage("repeater 2 { A }", A="SFSS")
    statuses = [stage.tick()[1] for _ in range(4)]
    assert statuses == [AGAIN, FAILURE, AGAIN, SUCCESS]


@pytest.mark.parametrize(
    "parent",
    [
        "selector { %s }",
        "sequence { %s A }",
        "inverter { %s }",
        "when not p { %s }",
        "parallel { %s A }",
        "repeater 2 { %s }",
    ],
)
def test_again_passes_up(parent: str) -> None:
    """Every parent passes on that its child has something to do again."""
    stage = Stage(parent % "repeater 2 { B }", B="S")
    assert stage.tick()[1] == AGAIN


def test_again_ends_with_its_child() -> None:
    """A parallel has nothing to do again once no child has."""
    stage = Stage("parallel { repeater 2 { A } B }", A="SR")
    assert stage.tick()[1] == AGAIN
    assert stage.tick() == ("A! B", RUNNING)


def test_again_after_cutting_short() -> None:
    """When a parallel's end stops an action that ran in this tick, the next tick has work to do.

    What such an action began, say driving, ends only when a tick goes by without it.
    """
    stage = Stage("selector { parallel { A B } C }", B="F")
    assert stage.tick() == ("A! B! C!", AGAIN)
    assert stage.tick() == ("C", RUNNING)


# When: the start


def test_when_false_fails() -> None:
    """A guard whose condition is false when it starts fails; its child is not ticked."""
    assert Stage("when p { A }").tick() == ("", FAILURE)


@pytest.mark.parametrize("status", ["S", "F", "R"])
def test_when_true_is_its_child(status: str) -> None:
    """A guard whose condition holds is what its child is."""
    expected = Stage("A", A=status).tick()
    assert Stage("when p { A }", "p", A=status).tick() == expected


def test_joined_conditions_are_one() -> None:
    """It interrupts when the whole condition becomes true, and stops when it becomes false."""
    stage = Stage("selector { when p and not (x < 2 or q) { A } B }", "p")
    assert stage.tick() == ("B!", RUNNING)
    assert stage.tick(q=1.0) == ("B", RUNNING)
    assert stage.tick(x=2.0) == ("B", RUNNING)
    assert stage.tick(q=0.0) == ("A!", RUNNING)
    assert stage.tick(x=3.0) == ("A", RUNNING)
    assert stage.tick(p=0.0) == ("B!", RUNNING)


@pytest.mark.parametrize(
    ("operator", "true_at"),
    [("<", "1"), ("<=", "12"), (">", "3"), (">=", "23"), ("==", "2"), ("!=", "13")],
)
def test_comparisons(operator: str, true_at: str) -> None:
    """Numbers compare as they do everywhere."""
    node = parse(f"when lap {operator} 2 {{ PatrolWaypoint }}")
    assert [
        value
        for value in "123"
        if condition(guard_of(node).condition, [0, 0, float(value), 0, 0], PLACES)()
    ] == [*true_at]


def test_conditions_are_complete() -> None:
    """Every operator of the language compiles, and no other."""
    for operator in (*OPERATORS, *FLAG_OPERATORS):
        assert condition(Condition("lap", operator, 0.0), [0.0] * 5, PLACES)() in (
            True,
            False,
        )
    with pytest.raises(ValueError, match="Expected an operator"):
        condition(Condition("lap", "=<", 0.0), [0.0] * 5, PLACES)


# When: abort rules


def test_abort_none() -> None:
    """With `none` the condition is asked at the start only."""
    stage = Stage("selector { when p abort none { A } B }", "p")
    assert stage.tick() == ("A!", RUNNING)
    assert stage.tick(p=0) == ("A", RUNNING)

    stage = Stage("selector { when p abort none { A } B }")
    assert stage.tick() == ("B!", RUNNING)
    assert stage.tick(p=1) == ("B", RUNNING)


@pytest.mark.parametrize("abort", ["self", "both"])
def test_abort_self(abort: str) -> None:
    """With `self` or `both` the guard stops its child as soon as the condition is false."""
    stage = Stage(f"selector {{ when p abort {abort} {{ sequence {{ A B }} }} C }}", "p", A="S")
    assert stage.tick() == ("A! B!", RUNNING)
    assert stage.tick(p=0) == ("C!", RUNNING)
    assert [event for event in stage.events if event[1] == ABORTED] == [(2, ABORTED), (4, ABORTED)]


def test_abort_bypasses_inverter() -> None:
    """Nodes inside an aborted subtree report nothing; an inverter above inverts the failure."""
    inside = Stage("when p { inverter { A } }", "p")
    inside.tick()
    assert inside.tick(p=0) == ("", FAILURE)
    above = Stage("inverter { when p { A } }", "p")
    above.tick()
    assert above.tick(p=0) == ("", SUCCESS)


@pytest.mark.parametrize("abort", ["lower", "both"])
def test_abort_lower(abort: str) -> None:
    """With `lower` or `both` a guard that becomes true interrupts a later branch at once."""
    stage = Stage(f"selector {{ A when p abort {abort} {{ B }} C D }}", A="F", C="F")
    assert stage.tick() == ("A! C! D!", RUNNING)
    assert stage.tick(p=1) == ("B!", RUNNING)
    assert (5, ABORTED) in stage.events


def test_abort_lower_keeps_itself() -> None:
    """With `lower` the guard's own child goes on when the condition is false."""
    stage = Stage("selector { when p abort lower { A } B }", "p")
    stage.tick()
    assert stage.tick(p=0) == ("A", RUNNING)


def test_abort_lower_needs_a_turn() -> None:
    """A condition that has been true all the time does not interrupt: it has to become true."""
    stage = Stage("selector { when p { A } B }", "p", A="FR")
    assert stage.tick() == ("A! B!", RUNNING)
    assert stage.tick() == ("B", RUNNING)
    assert stage.tick(p=0) == ("B", RUNNING)
    assert stage.tick(p=1) == ("A!", RUNNING)


def test_abort_lower_since_the_tick_before() -> None:
    """What counts is the truth on the tick before, not when the branch started."""
    stage = Stage("selector { when p abort lower { A } B }", "p", A="RRFR")
    assert stage.tick() == ("A!", RUNNING)
    assert stage.tick(p=0) == ("A", RUNNING)
    assert stage.tick() == ("A B!", RUNNING)
    assert stage.tick(p=1)[0] == "A!"


def test_abort_lower_in_a_sequence() -> None:
    """A sequence goes back to the guard's branch as well."""
    stage = Stage("sequence { inverter { when p { A } } B }")
    assert stage.tick() == ("B!", RUNNING)
    assert stage.tick(p=1) == ("A!", RUNNING)


@pytest.mark.parametrize(
    "branch", ["when p { A }", "repeater 2 { when p { A } }", "when not q { when p { A } }"]
)
def test_observed_through_decorators(branch: str) -> None:
    """The nearest composite observes a guard through the decorators between them."""
    stage = Stage(f"selector {{ {branch} B }}")
    assert stage.tick() == ("B!", RUNNING)
    assert stage.tick(p=1) == ("A!", RUNNING)

    inverted = Stage(f"sequence {{ inverter {{ {branch} }} B }}")
    assert inverted.tick() == ("B!", RUNNING)
    assert inverted.tick(p=1) == ("A!", RUNNING)


def test_abort_both() -> None:
    """`both` is `self` and `lower`, and it is the default."""
    for rule in ("", "abort both"):
        stage = Stage(f"selector {{ when p {rule} {{ A }} B }}", "p")
        assert stage.tick() == ("A!", RUNNING)
        assert stage.tick(p=0) == ("B!", RUNNING)
        assert stage.tick(p=1) == ("A!", RUNNING)


def test_observed_by_the_nearest_composite_only() -> None:
    """Composites further up don't observe it: its own composite is finished."""
    stage = Stage("selector { sequence { when p { A } B } C }")
    assert stage.tick() == ("C!", RUNNING)
    assert stage.tick(p=1) == ("C", RUNNING)


def test_not_observed_below_a_parallel() -> None:
    """A parallel has no lower branches: `lower` does nothing there, `self` does."""
    stage = Stage("parallel failure all { when p { A } B }")
    assert stage.tick() == ("B!", RUNNING)
    assert stage.tick(p=1) == ("B", RUNNING)

    stage = Stage("parallel failure all { when p { A } B }", "p")
    stage.tick()
    assert stage.tick(p=0) == ("B", RUNNING)


def test_observed_once_visited() -> None:
    """An inner guard that was not reached, as the outer one was false, is not observed."""
    stage = Stage("selector { when p abort none { when q { A } } B }")
    assert stage.tick() == ("B!", RUNNING)
    assert stage.tick(p=1, q=1) == ("B", RUNNING)

    reached = Stage("selector { when p abort none { when q { A } } B }", "p")
    assert reached.tick() == ("B!", RUNNING)
    assert reached.tick(q=1) == ("A!", RUNNING)


def test_takeover_starts_the_whole_branch() -> None:
    """The branch starts from its outermost node, so that an outer guard is asked again."""
    stage = Stage("selector { when p { when q { A } } B }", "p")
    assert stage.tick() == ("B!", RUNNING)
    assert stage.tick(p=0, q=1) == ("B!", RUNNING)


def test_observation_ends_going_back() -> None:
    """A composite that goes back to a branch forgets the guards of that branch and behind it."""
    stage = Stage("selector { when p { A } when q abort none { when x > 0 { B } } C }", "q", A="F")
    assert stage.tick() == ("C!", RUNNING)
    assert stage.tick(p=1, q=0) == ("A! C!", RUNNING)
    assert stage.tick(x=1) == ("C", RUNNING)


def test_observation_ends_with_the_composite() -> None:
    """A composite that starts again observes nothing that it visited before."""
    stage = Stage("selector { when p abort none { when q { A } } B }", "p", B="SR")
    assert stage.tick() == ("B!", SUCCESS)
    assert stage.tick(p=0) == ("B!", RUNNING)
    assert stage.tick(q=1) == ("B", RUNNING)


def test_first_guard_wins() -> None:
    """When several observed guards turn true in a tick, the first in the text wins."""
    stage = Stage("selector { when p { A } when q { B } C }")
    stage.tick()
    assert stage.tick(p=1, q=1) == ("A!", RUNNING)


def test_outer_guard_wins() -> None:
    """Guards are checked from the root down: an outer one spares the inner ones their check."""
    stage = Stage("selector { when p { A } selector { when q { B } C } }")
    assert stage.tick() == ("C!", RUNNING)
    assert stage.tick(p=1, q=1) == ("A!", RUNNING)

    nested = Stage("selector { when p { selector { when q { A } B } } C }", "p")
    assert nested.tick() == ("B!", RUNNING)
    assert nested.tick(p=0, q=1) == ("C!", RUNNING)


def test_parallel_ticks_children_before_a_guard() -> None:
    """A child of a parallel is resumed before the guard of a later one is checked and aborts."""
    board, calls = [0.0, 0.0, 0.0, 1.0, 0.0], []
    tree = short_tree("parallel { A when p abort self { B } }")
    tick = compile_tree(
        tree, lambda _: lambda _: RUNNING, board, PLACES, watch=lambda *call: calls.append(call)
    )
    assert tick() == RUNNING
    board[3] = 0.0
    calls.clear()
    assert tick() == FAILURE
    first, guarded = 1, 3  # positions
    assert calls[:2] == [(first, RUNNING), (guarded, ABORTED)]


def test_abort_resets() -> None:
    """An aborted subtree forgets everything: its place, its counts, its observations."""
    stage = Stage(
        "selector { when p abort lower { A } repeater 2 { sequence { B C } } }",
        A="F",
        B="S",
        C="SRSS",
    )
    assert stage.tick() == ("B! C!", AGAIN)
    assert stage.tick() == ("B! C!", RUNNING)
    assert stage.tick(p=1) == ("A! B! C!", AGAIN)
    assert stage.tick() == ("B! C!", SUCCESS)


# Around the table


def test_watch_sees_every_node() -> None:
    """A watch is called for each node that was ticked, by its place in the text, children first."""
    stage = Stage("selector { when p { A } sequence { B C } }", B="S")
    stage.tick()
    assert stage.events == [
        (1, FAILURE),
        (4, SUCCESS),
        (5, RUNNING),
        (3, RUNNING),
        (0, RUNNING),
    ]


def test_watch_changes_nothing() -> None:
    """A tree runs the same with and without a watch."""
    tree = short_tree("sequence { repeater 2 { A } B }")
    actions = dict.fromkeys(["MoveToGarbage", "PickupGarbage"], lambda _fresh: SUCCESS)
    watched = compile_tree(tree, actions, [0.0] * 5, PLACES, watch=lambda _place, _status: None)
    plain = compile_tree(tree, actions, [0.0] * 5, PLACES)
    assert [watched() for _ in range(4)] == [plain() for _ in range(4)]


def test_equal_leaves_are_two() -> None:
    """Leaves with the same action run apart: each has its own `fresh`."""
    stage = Stage("sequence { A A }", A="RSRS")
    assert [stage.tick()[0] for _ in range(3)] == ["A!", "A A!", "A"]


def test_trees_do_not_share_state() -> None:
    """Compiling a tree twice gives two trees that know nothing of each other."""
    tree = short_tree("repeater 2 { A }")
    actions = {"MoveToGarbage": lambda _fresh: SUCCESS}
    one, two = (compile_tree(tree, actions, [0.0] * 5, PLACES) for _ in range(2))
    assert (one(), two(), one(), two()) == (AGAIN, AGAIN, SUCCESS, SUCCESS)


def test_missing_action() -> None:
    """A tree whose action nobody implements is refused when it is compiled."""
    with pytest.raises(KeyError, match="PatrolWaypoint"):
        compile_tree(parse("PatrolWaypoint"), {}, [0.0] * 5, PLACES)


def test_thresholds() -> None:
    """Thresholds are the numbers that a key is compared with, ascending, each once."""
    tree = short_tree("selector { when x < 50 { A } when x > 20 { when x != 50 { B } } }")
    assert thresholds(tree, "batteryLevel") == (20.0, 50.0)
    assert thresholds(tree, "lap") == ()


def test_each_row_has_its_test() -> None:
    """Each row of the table in docs/semantics.md names a test of this file or of test_set."""
    rows = re.findall(
        r"\| `(test_\w+)` \|$", (DOCS / "semantics.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert len(rows) > 20
    assert [
        row for row in rows if not (callable(globals().get(row)) or hasattr(test_set, row))
    ] == []
