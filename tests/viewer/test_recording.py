"""A recording is the episode that it recorded, and the page's data is the recording."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from math import isclose
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from islandgp.bt.node import KEYS, size, walk
from islandgp.island.episode import run_episode
from islandgp.resources import resource
from islandgp.scoring.rewards import award
from islandgp.viewer.encode import LETTERS, encode, runs
from islandgp.viewer.page import page, replay_page
from islandgp.viewer.recording import FAILED, RUNS, STOPPED, SUCCEEDED, record
from tests.composed import composed
from tests.trees.worlds import random_trees
from tests.viewer.episodes import example, random_of_size, recorded

EXAMPLES = sorted(file.stem for file in (resource("grammar") / "examples").glob("*.bt"))


@pytest.mark.parametrize("name", ["all_rounder", "diverse", "poor"])
def test_recording_changes_nothing(name: str) -> None:
    """Who is recorded does the same as who is not: only the number of looks differs."""
    settings = composed()
    points = award(settings.rewards, settings.curriculum.multipliers(3))
    alone = run_episode(example(name), settings.world, 1, points)
    assert replace(recorded(name).episode, ticks=0) == replace(alone, ticks=0)


def test_every_tick_is_there() -> None:
    """Each series of a recording has an entry for each tick of the episode."""
    recording = recorded()
    assert recording.ticks == recording.episode.steps == 4200
    series = (recording.robot, recording.goals, recording.carried, recording.boards)
    assert {len(each) for each in series} == {4200}
    assert recording.humanoids.shape == (4200, recording.world.humanoids.count)
    assert {len(line) for line in recording.statuses} == {4200}
    assert len(recording.statuses) == size(recording.tree)


def test_statuses_and_counts_agree() -> None:
    """What a node did tick by tick adds up to its counts."""
    for codes, counts in zip(recorded().statuses, recorded().counts, strict=True):
        for code in (FAILED, SUCCEEDED, RUNS):
            assert codes.count(code) == counts[code]
        # Who is aborted and started again in one tick shows what came last.
        assert codes.count(STOPPED) <= counts[STOPPED]


def test_points_add_up() -> None:
    """The credits of a recording are its fitness."""
    recording = recorded()
    assert isclose(sum(c.points for c in recording.credits), recording.episode.fitness)
    assert all(0 <= c.tick < recording.ticks for c in recording.credits)


def test_garbage_is_what_the_robot_found() -> None:
    """As many items vanish as were picked up, each within reach of the robot."""
    recording = recorded()
    gone = [stay for stay in recording.garbage if stay[3] < recording.ticks]
    picked = [c for c in recording.credits if c.event.name == "PICKUP"]
    assert len(gone) == len(picked) > 10
    reach = recording.world.robot.pickup_reach
    for x, y, _, end in gone:
        assert abs(complex(x, y) - recording.robot[end]) <= reach + 1e-6


@given(codes=st.binary(max_size=60).map(lambda data: bytes(b % 5 for b in data)))
def test_runs_are_lossless(codes: bytes) -> None:
    """Statuses told as runs are read as the page reads them, to the same statuses."""
    found = re.findall(r"([.fsrx])(\d*)", runs(codes))
    back = "".join(letter * int(count or 1) for letter, count in found)
    assert back == "".join(LETTERS[code] for code in codes)


def test_positions_are_told_to_the_tenth_of_a_metre() -> None:
    """Positions, summed up as the page sums them, are within rounding of the recorded ones."""
    recording = recorded()
    told = encode(recording, title="t")["robot"]
    x = y = 0
    for i, (dx, dy) in enumerate(zip(told["x"][:-1], told["y"][:-1], strict=True)):
        x, y = x + dx, y + dy
        assert abs(complex(x / 10, y / 10) - recording.robot[i * told["every"]]) < 0.08


def test_changes_are_lossless() -> None:
    """The blackboard told as changes has the value of each tick."""
    recording = recorded()
    told = encode(recording, title="t")["board"]
    for place, entry in enumerate(told):
        values: dict[int, Any] = {}
        tick = 0
        for since, value in zip(entry["changes"][::2], entry["changes"][1::2], strict=True):
            tick += since
            values[tick] = value
        now = None
        for tick, board in enumerate(recording.boards):
            now = values.get(tick, now)
            assert now == round(board[place], 1)
    assert [entry["key"] for entry in told] == list(KEYS)


@pytest.mark.parametrize("name", EXAMPLES)
def test_page_of_an_example_is_small(name: str) -> None:
    """The page of a whole episode is a few hundred kilobytes at most."""
    assert len(page(recorded(name), title=name).encode()) < 400_000


@pytest.mark.slow
def test_page_of_any_tree_is_below_a_megabyte() -> None:
    """The pages of 100 random trees stay below a megabyte."""
    for tree in random_trees(composed(), 100):
        assert len(replay_page(tree, composed(), 0, 3, "t").encode()) < 1_000_000


def test_page_of_a_restless_tree_is_below_a_megabyte() -> None:
    """So does that of a large tree that starts anew in each tick: nothing in it can be told as
    a long run."""
    tree = example("poor")._replace(kind="sequence")
    for _ in range(4):
        tree = tree._replace(children=(tree, *random_of_size(12).children))
    whole = composed()
    limits = whole.world.episode.model_copy(update={"negative": 420, "stagnation": 420})
    settings = whole.model_copy(
        update={"world": whole.world.model_copy(update={"episode": limits})}
    )
    text = page(record(tree, settings, seed=0, stage=3), title="restless")
    assert len(text.encode()) < 1_000_000


def test_page_needs_nothing_else() -> None:
    """No address of another file is in the page, and every place of the template is filled."""
    text = page(recorded(), title="t")
    assert not re.search(
        r"https?:|\bsrc=|<link|@import|url\(", text.replace("http://www.w3.org", "")
    )
    assert "{{" not in text


def test_hostile_title() -> None:
    """A title with markup, script ends or template places is shown as it is."""
    title = "</script><b>{{script}}&"
    text = page(recorded(), title=title)
    assert text.count("</script>") == 2
    assert "&lt;/script&gt;&lt;b&gt;{{script}}&amp;" in text
    inside = re.search(r'id="data">(.*?)</script>', text, re.DOTALL)
    assert inside is not None
    assert json.loads(inside[1])["title"] == title


def test_every_action_is_told_in_the_tree_and_in_the_data() -> None:
    """The picture and the data have the same nodes in the same order."""
    tree = example("diverse")
    text = page(recorded("diverse", 2), title="t")
    kinds = re.findall(r'<g class="node (\w+)"', text)
    assert kinds == [node.kind for node in walk(tree)]
    data = encode(recorded("diverse", 2), title="t")
    assert [node["kind"] for node in data["nodes"]] == kinds
