"""A recording is the episode that it recorded, and the page's data is the recording."""

from __future__ import annotations

import dataclasses
import re
from base64 import b64decode
from functools import partial
from math import isclose
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from islandgp.bt.core.node import size, walk
from islandgp.domain import Scene, Shape
from islandgp.errors import DomainError
from islandgp.resources import resource
from islandgp.viewer.encode import GRID, LETTERS, encode, path, runs
from islandgp.viewer.page import page
from islandgp.viewer.recording import RUNS, record
from tests.composed import composed
from tests.viewer.episodes import example, going, island, random_of_size, recorded, small

EXAMPLES = sorted(file.stem for file in (resource("grammar") / "examples").glob("*.bt"))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["all_rounder", "diverse", "poor"])
def test_recording_changes_nothing(name: str) -> None:
    """Who is recorded does the same as who is not."""
    setting = island()
    weights = setting.curriculum.multipliers(3)
    assert recorded(name).outcome == setting.domain.run_episode(example(name), 1, weights)


def test_every_tick_is_there() -> None:
    """Each series of a recording has an entry for each tick of the episode."""
    recording = recorded()
    assert recording.ticks == 4200
    assert recording.outcome.seconds == 420
    assert len(recording.boards) == 4200
    assert len(recording.scenes) == 4200
    assert {len(line) for line in recording.statuses} == {4200}
    assert len(recording.statuses) == size(recording.tree)


def test_points_add_up() -> None:
    """The credits of a recording are its fitness."""
    recording = recorded()
    assert isclose(sum(c.points for c in recording.credits), recording.outcome.fitness)
    assert all(0 <= c.tick < recording.ticks for c in recording.credits)


def test_scenes_of_any_domain() -> None:
    """What stays is kept once, what comes and goes with its ticks, what moves at each tick."""
    scene = encode(small(scenes=going()), title="t")["scene"]
    looks = [(style, round(size * 20 / GRID, 9), text) for style, size, text in scene["looks"]]
    assert (scene["width"], scene["height"]) == (GRID, GRID / 2)
    assert [(looks[look], x, y) for look, x, y in scene["fixed"]] == [
        ((1, 1, ""), GRID / 2, 9 * GRID / 20)
    ]
    assert [(looks[look], begin, end) for look, _, _, begin, end in scene["items"]] == [
        ((1, 0.5, "here"), 0, 5)
    ]
    (robot,) = scene["movers"]
    assert robot["way"] == [0, 0, 5 * GRID // 20, 19, 19 * GRID // 20, 0]
    assert [look if k % 2 == 0 else looks[look] for k, look in enumerate(robot["looks"])] == [
        *(0, (0, 0.5, "0")),
        *(10, (0, 0.5, "1")),
    ]
    assert scene["frames"] == []


def test_equal_things_at_one_place() -> None:
    """Two of a kind at the same place are two; one of them can go."""
    stone = Shape("stone", 1, 1, 1)
    scenes = [Scene((0, 0, 2, 2), items=(stone,) * number) for number in (2, 1, 0)]
    items = encode(small(scenes=scenes, ticks=3), title="t")["scene"]["items"]
    assert sorted(item[3:] for item in items) == [[0, 1], [0, 2]]


def test_a_domain_that_draws_nothing() -> None:
    """Tree, blackboard, timeline and points are there all the same."""
    recording = small()
    assert recording.scenes == ()
    assert (recording.ticks, len(recording.boards)) == (20, 20)
    assert encode(recording, title="t")["scene"] is None


def test_a_domain_that_reports_no_ticks() -> None:
    """All that the nodes did is in one tick; nothing is divided by nothing."""
    recording = small(silent=True)
    assert recording.ticks == 1
    assert {codes[0] for codes in recording.statuses} == {RUNS}
    assert page(recording, title="t")


def test_frames_are_kept_where_they_change() -> None:
    """A picture that comes again is in the page once."""
    scenes = [
        Scene((0, 0, 1, 1), frame=partial(bytes, b"ab"[tick // 3 % 2 :][:1])) for tick in range(12)
    ]
    recording = small(scenes=scenes, ticks=12)
    assert [tick for tick, _ in recording.frames] == [0, 3, 6, 9]
    encoded = encode(recording, title="t")["scene"]
    assert [b64decode(frame) for frame in encoded["frames"]] == [b"a", b"b"]
    assert encoded["shown"] == [0, 0, 3, 1, 3, 0, 3, 1]


def test_many_frames_are_thinned_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures of more bytes than a page may have: evenly spread ones of them are shown."""
    monkeypatch.setattr("islandgp.viewer.encode.MAX_FRAME_BYTES", 30)
    scenes = [Scene((0, 0, 1, 1), frame=partial(bytes, bytes([tick]) * 10)) for tick in range(12)]
    encoded = encode(small(scenes=scenes, ticks=12), title="t")["scene"]
    assert len(encoded["frames"]) == 3
    assert encoded["shown"] == [0, 0, 4, 1, 4, 2]


@pytest.mark.parametrize(
    ("scenes", "message"),
    [
        (
            [Scene((0, 0, 1, 1), movers=(Shape("cat", 0, 0, 1),))],
            "styles (robot, stone), found 'cat'",
        ),
        (
            [Scene((0, 0, 1, 1), movers=(Shape("robot", 0, 0, 1),) * n) for n in (1, 2)],
            "as many movers in each tick, found 1 and 2",
        ),
    ],
)
def test_scenes_that_break_the_contract(scenes: list[Scene], message: str) -> None:
    """One clear error, not a page that does not work."""
    with pytest.raises(DomainError, match=re.escape(message)):
        small(scenes=scenes)


@given(codes=st.binary(max_size=60).map(lambda data: bytes(b % 5 for b in data)))
def test_runs_are_lossless(codes: bytes) -> None:
    """Statuses encoded as runs are read as the page reads them, to the same statuses."""
    matches = re.findall(r"([.fsrx])(\d*)", runs(codes))
    decoded = "".join(letter * int(count or 1) for letter, count in matches)
    assert decoded == "".join(LETTERS[code] for code in codes)


def places(way: list[int], ticks: int) -> list[tuple[float, float]]:
    """The places of a way at each tick, read as the page reads them."""
    at, x, y = 0, way[1], way[2]
    positions = [(float(x), float(y))]
    for past, dx, dy in zip(way[3::3], way[4::3], way[5::3], strict=True):
        positions += [(x + dx * i / past, y + dy * i / past) for i in range(1, past + 1)]
        at, x, y = at + past, x + dx, y + dy
    assert at == ticks - 1
    return positions


COORDINATES = st.floats(-5000, 5000) | st.integers(-3, 3).map(float)


@given(way=st.lists(st.tuples(COORDINATES, COORDINATES), min_size=1, max_size=60))
def test_ways_are_encoded_exactly_enough(way: list[tuple[float, float]]) -> None:
    """At each tick a way is within one part of the grid of the original, for any way."""
    xs, ys = zip(*way, strict=True)
    decoded = places(path(xs, ys), len(way))
    for (x, y), (there_x, there_y) in zip(decoded, way, strict=True):
        assert abs(x - there_x) <= 1 + 1e-6
        assert abs(y - there_y) <= 1 + 1e-6


def test_positions_are_exact_to_the_tenth_of_a_metre() -> None:
    """On the island a place in the page is a tenth of a metre off at most, in x and in y."""
    recording = recorded()
    movers = encode(recording, title="t")["scene"]["movers"]
    unit = composed().world.side / GRID
    assert unit == 0.1
    tracks = zip(*(scene.movers for scene in recording.scenes), strict=True)
    for mover, entry in zip(tracks, movers, strict=True):
        way = entry["way"] if isinstance(entry["way"], list) else movers[entry["way"]]["way"]
        for (x, y), shape in zip(places(way, recording.ticks), mover, strict=True):
            assert abs(x * unit - shape.x) <= unit + 1e-9
            assert abs(y * unit - shape.y) <= unit + 1e-9


def test_changes_are_lossless() -> None:
    """The blackboard encoded as changes has the value of each tick."""
    recording = recorded()
    encoded = encode(recording, title="t")["board"]
    for place, entry in enumerate(encoded):
        values: dict[int, Any] = {}
        tick = 0
        for since, value in zip(entry["changes"][::2], entry["changes"][1::2], strict=True):
            tick += since
            values[tick] = value
        now = None
        for tick, board in enumerate(recording.boards):
            now = values.get(tick, now)
            assert now == round(board[place], 1)
    assert [entry["key"] for entry in encoded] == list(recording.schema.vocabulary.keys)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name in ("all_rounder", "poor") else pytest.mark.slow)
        for name in EXAMPLES
    ],
)
def test_page_of_an_example_is_small(name: str) -> None:
    """The page of a whole episode is about a hundred kilobytes."""
    assert len(page(recorded(name), title=name).encode()) < 200_000


@pytest.mark.slow
def test_page_of_a_restless_tree_is_below_a_megabyte() -> None:
    """So does that of a large tree that starts again in each tick: nothing in it can be encoded as
    a long run."""
    tree = example("poor")._replace(kind="sequence")
    for _ in range(4):
        tree = tree._replace(children=(tree, *random_of_size(12).children))
    setting = island(negative=420, stagnation=420)
    text = page(record(tree, setting, seed=0, stage=3), title="restless")
    assert len(text.encode()) < 1_000_000


@pytest.mark.slow
def test_every_action_is_in_the_tree_and_in_the_data() -> None:
    """The picture and the data have the same nodes in the same order."""
    tree = example("diverse")
    text = page(recorded("diverse", 2), title="t")
    kinds = re.findall(r'<g class="node (\w+)"', text)
    assert kinds == [node.kind for node in walk(tree)]
    data = encode(recorded("diverse", 2), title="t")
    assert [node["kind"] for node in data["nodes"]] == kinds


def test_actions_are_painted_by_what_they_earn() -> None:
    """An action has the colour of its component; one that earns nothing that of the next in its
    sequence."""
    encoded = encode(recorded(), title="t")
    paints = {
        a: encoded["components"][i]["name"] if i >= 0 else "" for a, i in encoded["paints"].items()
    }
    assert paints["PickupGarbage"] == paints["MoveToGarbage"] == "garbage"
    assert paints["DeliverToClearingPoint"] == "delivery"
    assert encode(small("selector { Stay }"), title="t")["paints"] == {"Stay": -1}


def test_hostile_words() -> None:
    """What a domain calls its things is shown as it is, and ends no script."""
    bad = "</script><b>"
    schema = small().schema
    style = dataclasses.replace(schema.styles["robot"], meaning=bad)
    scenes = [Scene((0, 0, 9, 9), movers=(Shape("robot", 1, 1, 1, bad),))]
    schema = dataclasses.replace(schema, styles={"robot": style})
    text = page(small(scenes=scenes, schema=schema), title="t")
    assert text.count("</script>") == 2
