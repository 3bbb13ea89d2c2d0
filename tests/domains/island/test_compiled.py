"""The compiled loop gives the same episodes as Python's, and is left out where it cannot be."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import pytest

import islandgp.domains.island
from islandgp.bt.core.language import parse
from islandgp.domains.island import compiled, episode
from islandgp.domains.island.episode import run_episode
from islandgp.domains.island.state import State, build_island
from islandgp.domains.island.world import IslandWorld
from tests.domains.island.days import points, world
from tests.domains.island.test_determinism import ALL_ROUNDER, RESTLESS, busy, gp_tree
from tests.profiles import sweep

WAITING = "selector { MoveToHumanoid when batteryLevel < 5 { ExecuteCharge } }"


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The first episode may be compiled."""
    monkeypatch.setattr(compiled, "WARM", 0)
    compiling = compiled._functions
    compiling.cache_clear()
    yield
    compiling.cache_clear()


@sweep("island", [busy(), world()], ids=["busy", "usual"], quick=1)
@pytest.mark.usefixtures("at_once")
def test_outcomes_are_the_same(island: IslandWorld, monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last bit, and with as many ticks: full, waiting and random trees."""
    pytest.importorskip("numba", reason="needs islandgp[fast]")
    trees = [*map(parse, (ALL_ROUNDER, RESTLESS, WAITING)), *map(gp_tree, range(6))]
    quick = [run_episode(tree, island, seed, points()) for seed, tree in enumerate(trees)]
    assert compiled._functions() is not None
    monkeypatch.setattr(compiled, "_functions", lambda: None)
    assert quick == [run_episode(tree, island, seed, points()) for seed, tree in enumerate(trees)]


@pytest.mark.usefixtures("at_once")
def test_crowded_episodes_are_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a body touches two others at once, the outcome is that of every step."""
    pytest.importorskip("numba", reason="needs islandgp[fast]")
    people = world().humanoids.model_copy(update={"count": 40, "speed": 9.0})
    island, trees = world().model_copy(update={"humanoids": people}), [parse(ALL_ROUNDER)] * 8
    flights: list[bool] = []

    def counted(state: State, *, flies: bool = True) -> compiled.Compiled | None:
        flights.append(flies)
        return compiled.compiled_for(state, flies=flies)

    monkeypatch.setattr(episode, "compiled_for", counted)
    quick = [run_episode(tree, island, seed, points()) for seed, tree in enumerate(trees)]
    assert False in flights
    assert True in flights
    monkeypatch.setattr(compiled, "_functions", lambda: None)
    assert quick == [run_episode(tree, island, seed, points()) for seed, tree in enumerate(trees)]


@pytest.mark.usefixtures("at_once")
def test_flights_need_the_sums_of_chipmunk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where compiled sums are rounded in another way, Chipmunk makes every step."""
    pytest.importorskip("numba", reason="needs islandgp[fast]")
    functions = compiled._functions()
    assert functions is not None
    assert functions.flies
    assert not compiled._adds_as_chipmunk(lambda *_: None)
    before = run_episode(parse(ALL_ROUNDER), world(), 3, points())
    monkeypatch.setattr(compiled, "_functions", lambda: functions._replace(flies=False))
    assert run_episode(parse(ALL_ROUNDER), world(), 3, points()) == before


@pytest.mark.parametrize("lacking", ["numba", "a numba that works", "Chipmunk's functions"])
@pytest.mark.usefixtures("at_once")
def test_python_does_without_it(lacking: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without numba, with one that cannot be imported, and with a pymunk that hides functions."""
    if lacking == "numba":
        monkeypatch.setattr(compiled, "find_spec", lambda _: None)
    elif lacking == "a numba that works":
        monkeypatch.setattr(compiled, "find_spec", lambda _: object())
        monkeypatch.setitem(sys.modules, "islandgp.domains.island.kernel", None)
        monkeypatch.delattr(islandgp.domains.island, "kernel", raising=False)
    else:
        monkeypatch.setattr(compiled.engine, "addresses", {})
    assert compiled.compiled_for(build_island(world(), 0, points(), ())) is None


def test_short_commands_do_not_wait_for_numba(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first episodes of a process import nothing."""
    monkeypatch.setattr(compiled, "_episodes", iter(range(compiled.WARM)))
    monkeypatch.setattr(compiled, "_functions", lambda: pytest.fail("imported"))
    island = build_island(world(), 0, points(), ())
    assert all(compiled.compiled_for(island) is None for _ in range(compiled.WARM))
