"""Domains over simulators that are stepped: leaves, events, counters, endings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import pytest
from pydantic import BaseModel

from islandgp.bt.core.language import parse
from islandgp.bt.core.vocabulary import Action, Vocabulary, enumeration, flag, number
from islandgp.domain import (
    RUNNING,
    Counter,
    Event,
    EventLog,
    Outcome,
    RewardTable,
    Scene,
    Schema,
    SimulatorDomain,
)
from islandgp.errors import DomainError

SCHEMA = Schema(
    vocabulary=Vocabulary(
        "counting",
        {name: Action(name) for name in ("Yes", "No", "Wait", "Twice", "Odd")},
        {"ready": flag("it is"), "n": number("how many ticks", 0, 9)},
    ),
    components={"points": "what is earned"},
    events={"done": Event("something is done", "things")},
    counters={"done": Counter("things done"), "calls": Counter("calls of leaves")},
    task="Counts.",
)
REWARDS = RewardTable.model_validate({"events": {"done": {"component": "points", "per_unit": 2}}})


class World(BaseModel):
    """How long an episode is."""

    ticks: int = 10


class Counting:
    """An episode with leaves of every sort."""

    def __init__(self, _: World, __: int, log: EventLog) -> None:
        self.log = log
        self.calls: list[str] = []
        self.n = 0

    def sense(self) -> dict[str, float]:
        return {"ready": self.n > 2, "n": self.n}

    def step(self) -> str:
        self.n += 1
        return "enough" if self.n == 6 else ""

    def measures(self) -> dict[str, float]:
        return {"calls": len(self.calls)}

    def Yes(self) -> bool:
        self.calls.append("yes")
        self.log("done", 1.5)
        return True

    def No(self) -> bool:
        self.calls.append("no")
        return False

    def Wait(self) -> int:
        self.calls.append("wait")
        return RUNNING

    def Twice(self) -> Iterator[None]:
        self.calls.append("begin")
        yield
        self.calls.append("go on")
        return True

    def Odd(self) -> None:
        self.calls.append("odd")


class Watching:
    """An observer that ignores what it sees."""

    def node(self, place: int, status: int) -> None:
        """See `Observer`."""

    def tick(self, board: Sequence[float], scene: Scene | None) -> None:
        """See `Observer`."""

    def credit(self, component: str, points: float, event: str, action: str) -> None:
        """See `Observer`."""


def run(
    text: str, ticks: int = 10, observer: Watching | None = None, **methods: object
) -> tuple[list[str], Outcome]:
    """The calls of leaves, and the outcome; `methods` take the place of the episode's own."""
    episodes: list[Counting] = []

    def episode(world: World, seed: int, log: EventLog) -> Counting:
        episodes.append(Counting(world, seed, log))
        vars(episodes[0]).update(methods)
        return episodes[0]

    class Domain(SimulatorDomain):
        World, Episode, schema, step_s = World, episode, SCHEMA, 0.5

    domain = Domain.make(World(ticks=ticks), REWARDS)
    outcome = domain.run_episode(parse(text, SCHEMA.vocabulary), 0, {"points": 10.0}, observer)
    return episodes[0].calls, outcome


def test_events_earn_points_and_are_counted() -> None:
    """Six ticks of one event each: amount 1.5 at 2 points, times the weight 10."""
    calls, outcome = run("Yes")
    assert calls == ["yes"] * 6
    assert outcome.components == {"points": 6 * 30.0}
    assert outcome.counters == {"done": 6.0, "calls": 6.0}
    assert (outcome.seconds, outcome.endings) == (3.0, ("enough",))


def test_time_runs_out() -> None:
    """Where `step` never ends the episode, the ticks do."""
    _, outcome = run("Yes", ticks=4)
    assert (outcome.seconds, outcome.endings) == (2.0, ("time",))


def test_a_generator_runs_over_several_ticks() -> None:
    """Each yield is a tick; it begins from the start when its node starts again."""
    calls, _ = run("sequence { Twice Yes }", ticks=4)
    assert calls == ["begin", "go on", "yes", "begin", "go on", "yes"]


def test_two_leaves_of_a_generator_do_not_share_it() -> None:
    """Two nodes of one action in a parallel have a generator each."""
    calls, _ = run("parallel { Twice Twice }", ticks=2)
    assert calls == ["begin", "begin", "go on", "go on"]


def test_an_aborted_generator_begins_again() -> None:
    """The guard turns true in the fourth tick, and stops what runs behind it."""
    calls, _ = run("selector { when ready abort lower { Yes } Twice }", ticks=4)
    assert calls == ["begin", "go on", "begin", "yes"]


def holding(log: list[str]) -> Callable[[], Iterator[None]]:
    """An action that holds something until it is stopped."""

    def hold() -> Iterator[None]:
        log.append("hold")
        try:
            while True:
                yield
        finally:
            log.append("release")

    return hold


@pytest.mark.parametrize("observed", [False, True])
def test_an_aborted_generator_is_closed_at_once(observed: bool) -> None:
    """Its `finally` runs before the branch that takes over, as in a bound tree on a robot."""
    log: list[str] = []
    tree = "selector { when n == 2 abort lower { Odd } Twice }"
    observer = Watching() if observed else None

    def odd() -> bool:
        log.append("odd")
        return True

    run(tree, 4, observer, Twice=holding(log), Odd=odd)
    assert log == ["hold", "release", "odd", "hold", "release"]


@pytest.mark.parametrize("ticks", [2, 3])
def test_events_of_a_finally_belong_to_the_episode(ticks: int) -> None:
    """A generator that runs at the episode's end is closed before the outcome is made."""

    class Holder(Counting):
        def Twice(self) -> Iterator[None]:
            try:
                while True:
                    yield
            finally:
                self.Yes()

    class Domain(SimulatorDomain):
        World, Episode, schema = World, Holder, SCHEMA

    domain = Domain.make(World(ticks=ticks), REWARDS)
    outcome = domain.run_episode(parse("Twice", SCHEMA.vocabulary), 0, {})
    assert outcome.components == {"points": 3.0}
    assert outcome.counters == {"done": 1.0, "calls": 1.0}


def test_keys_are_sensed_before_the_tick() -> None:
    """A number on the blackboard is the one of the tick's start."""
    calls, _ = run("selector { when n >= 4 { Yes } No }")
    assert calls == ["no"] * 4 + ["yes"] * 2


def test_words_of_a_key(monkeypatch: pytest.MonkeyPatch) -> None:
    """`sense` gives a key's word or its index; another word is named with those that there are."""
    mode = enumeration("what it does", ("idle", "busy"))
    vocabulary = replace(SCHEMA.vocabulary, keys={**SCHEMA.vocabulary.keys, "mode": mode})
    monkeypatch.setitem(globals(), "SCHEMA", replace(SCHEMA, vocabulary=vocabulary))
    guarded = "selector { when mode == busy { Yes } No }"
    for value, expected in (("busy", ["yes"]), (1, ["yes"]), ("idle", ["no"])):
        calls, _ = run(guarded, 1, sense=lambda v=value: {"ready": 0, "n": 0, "mode": v})
        assert calls == expected
    with pytest.raises(
        DomainError, match="Expected one of idle, busy as the value of the key mode"
    ):
        run(guarded, 1, sense=lambda: {"ready": 0, "n": 0, "mode": "lazy"})


def test_a_leaf_without_a_status_is_refused() -> None:
    """A forgotten return is no status."""
    with pytest.raises(DomainError, match="True, False or RUNNING from the action Odd, found None"):
        run("Odd")


def test_an_unknown_event_is_refused() -> None:
    """With the events that there are."""
    with pytest.raises(DomainError, match=r"an event of the schema \(done\), found 'dome'"):
        EventLog(REWARDS, SCHEMA, {})("dome")


@pytest.mark.parametrize("amount", [float("nan"), float("inf")])
def test_an_amount_must_be_finite(amount: float) -> None:
    """Points made of it would be none."""
    with pytest.raises(DomainError, match=f"a finite amount of the event 'done', found {amount}"):
        EventLog(REWARDS, SCHEMA, {})("done", amount)


def test_a_missing_key_or_counter_is_refused() -> None:
    """What `sense` or `measures` leaves out."""
    with pytest.raises(DomainError, match="a value of the key n from"):
        run("Yes", sense=lambda: {"ready": 1})
    with pytest.raises(DomainError, match="the counter calls from `measures`"):
        run("Yes", measures=dict)


def test_counters_default_to_the_events() -> None:
    """A schema without counters counts every event."""
    schema = Schema(SCHEMA.vocabulary, SCHEMA.components, SCHEMA.events, "Counts.")
    assert {name: c.meaning for name, c in schema.counters.items()} == {"done": "something is done"}


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("n", float("nan"), "a number of at least 0 "),
        ("n", float("inf"), "a number of at least 0 "),
        ("ready", float("nan"), "True or False "),
    ],
)
def test_a_key_that_is_no_number_is_named(key: str, value: float, expected: str) -> None:
    """No condition could ask for it: every comparison would be false."""
    values = {"ready": 0.0, "n": 1.0, key: value}
    with pytest.raises(DomainError, match=f"Expected {expected}.*key {key} .*found {value}"):
        run("Yes", sense=lambda: values)
