"""The replay page in a real browser: it plays, scrubs, and shows what happened."""

from __future__ import annotations

import base64
import dataclasses
import math
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from pandas import DataFrame  # type: ignore[import-untyped] # its stubs are a package apart

from islandgp.bt.core.node import leaf, walk
from islandgp.compare.comparable import compare_arms
from islandgp.compare.report import build
from islandgp.domain import Scene, Shape, ShapeStyle
from islandgp.viewer.encode import GRID
from islandgp.viewer.page import page
from islandgp.viewer.recording import IDLE, Recording, record
from tests.compare.fake_runs import fake_arm, fake_run
from tests.viewer.browser import Browser
from tests.viewer.episodes import island, random_of_size, recorded, small

LETTERS = ".fsrx"
STATE = (
    "[...document.querySelectorAll('#tree .node')]"
    ".map(n => ['f','s','r','x'].find(c => n.classList.contains(c)) ?? '.').join('')"
)
DRAWN = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))"


@pytest.fixture
def tab(browser: Browser, file: Path) -> Iterator[Browser]:
    """The page, just opened; fails where the browser complained about anything."""
    browser.console.clear()
    browser.open(f"file://{file}")
    yield browser
    browser.run("1")
    assert browser.console == []


def seek(browser: Browser, tick: int) -> None:
    browser.run(f"player.play(false); player.seek({tick}); {DRAWN}")


def expected(recording: Recording, tick: int) -> str:
    return "".join(LETTERS[line[tick]] for line in recording.statuses)


def test_right_nodes_are_lit(tab: Browser) -> None:
    """At any time exactly the nodes are lit that did something in that tick, in its colour."""
    recording = recorded()
    for tick in (0, 1, 115, 116, 142, 143, 1000, 2222, 3333, recording.ticks - 1):
        seek(tab, tick)
        assert tab.run(STATE) == expected(recording, tick), tick


def test_the_address_has_the_start_time(browser: Browser, file: Path) -> None:
    """replay.html#t=96.6 opens at that second."""
    browser.open(f"file://{file}#t=96.6")
    assert browser.run("document.getElementById('clock').textContent") == "96.6 s"
    assert browser.run(STATE) == expected(recorded(), 966)


def test_blackboard_and_fitness(tab: Browser) -> None:
    """Beside the tree are the blackboard and the points of that tick."""
    recording = recorded()
    seek(tab, 2000)
    entries = tab.run("[...document.querySelectorAll('.entry b')].map(b => b.textContent)")
    battery, room, lap, garbage, humanoid = recording.boards[2000]
    assert entries == [
        f"{battery:.1f}",
        f"{room:g}",
        f"{lap:g}",
        "yes" if garbage else "no",
        "yes" if humanoid else "no",
    ]
    assert len(entries) == len(recording.schema.vocabulary.keys)
    won = sum(c.points for c in recording.credits if c.tick <= 2000)
    text = tab.run("document.getElementById('score').textContent")
    assert text == f"{math.floor(won + 0.5):,} points"


def test_it_plays_and_pauses(tab: Browser) -> None:
    """Space plays: time passes at the chosen speed; space again stops it."""
    tab.run("player.speed(20)")
    tab.press(" ")
    tick = tab.run(
        "new Promise(done => { const began = performance.now(), look = () =>"
        " performance.now() - began > 500 ? done(player.state.tick) : requestAnimationFrame(look);"
        " look(); })"
    )
    assert 40 < tick < 160  # half a second at twenty times ten ticks a second is 100
    tab.press(" ")
    stopped = tab.run(f"{DRAWN}.then(() => player.state.tick)")
    assert tab.run(f"{DRAWN}.then(() => player.state.tick)") == stopped == int(stopped)


def test_it_ends(tab: Browser) -> None:
    """At the end it stops by itself, and playing again starts from the beginning."""
    last = recorded().ticks - 1
    tab.run(f"player.seek({last - 2}); player.speed(100); player.play(true)")
    tab.run(f"{DRAWN}.then(() => {DRAWN})")
    assert tab.run("[player.state.playing, player.state.tick]") == [False, last]
    tab.run(f"player.play(true); {DRAWN}")
    assert tab.run("player.state.tick") < 200


def test_keys(tab: Browser) -> None:
    """Arrows step, Home and End jump, brackets change the speed, comma and dot find decisions."""
    tab.press("ArrowRight")
    tab.press("ArrowRight")
    tab.press("ArrowLeft")
    assert tab.run("player.state.tick") == 1
    tab.press("End")
    assert tab.run("player.state.tick") == recorded().ticks - 1
    tab.press("Home")
    assert tab.run("player.state.tick") == 0
    tab.press("]")
    assert tab.run("document.getElementById('speed').value") == "20"
    tab.press(".")
    first = tab.run("player.state.tick")
    codes = [
        recorded().statuses[place]
        for place, node in enumerate(walk(recorded().tree))
        if node.action
    ]
    assert any(line[first] != IDLE for line in codes)
    tab.press(",")
    assert tab.run("player.state.tick") == 0


def centre(browser: Browser, selector: str) -> Any:
    return browser.run(
        f"(b => [b.left + b.width / 2, b.top + b.height / 2])"
        f"(document.querySelector({selector!r}).getBoundingClientRect())"
    )


def test_scrubbing(tab: Browser) -> None:
    """A click in the middle of the timeline goes to the middle of the episode."""
    half = recorded().ticks / 2
    left, top, x = tab.run(
        f"(b => [b.left, b.top, timeline.place({half})])(timeline.canvas.getBoundingClientRect())"
    )
    tab.click(left + x, top + 30)
    assert abs(tab.run("player.state.tick") - half) < 10


def test_click_on_a_node_goes_to_its_next_start(tab: Browser) -> None:
    """A click on MoveToHumanoid shows the next time that it starts."""
    actions = [n.action for n in walk(recorded().tree)]
    place = actions.index("MoveToHumanoid")
    start = next(t for t, code in enumerate(recorded().statuses[place]) if code != IDLE)
    tab.click(*centre(tab, f"[data-place='{place}']"))
    assert tab.run(f"{DRAWN}.then(() => player.state.tick)") == start
    assert "MoveToHumanoid" in tab.run("document.getElementById('why').textContent")


def test_zoom(tab: Browser) -> None:
    """Plus zooms into the world, zero shows all of it again, F follows the robot."""
    before = tab.run("scene.view.scale")
    tab.press("+")
    tab.run(DRAWN)
    assert tab.run("scene.view.scale") > before
    tab.press("0")
    tab.run(DRAWN)
    assert tab.run("scene.view.scale") == before
    seek(tab, 500)
    tab.press("f")
    tab.run(DRAWN)
    scenes = recorded().scenes
    robot = [scene.movers[-1] for scene in scenes]
    unit = max(scene.bounds[2] for scene in scenes) / GRID
    x, y = tab.run("[scene.view.x, scene.view.y]")
    assert abs(complex(x * unit, y * unit) - complex(robot[500].x, robot[500].y)) < 0.2


def test_something_is_drawn(tab: Browser) -> None:
    """The canvases are not empty: each has many colours."""
    for canvas in ("scene", "chart", "timeline"):
        colours = tab.run(
            "(c => new Set(new Uint32Array(c.getContext('2d')"
            ".getImageData(0, 0, c.width, c.height).data.buffer)).size)"
            f"(document.getElementById('{canvas}'))"
        )
        assert colours > 20, canvas


def test_in_a_frame_without_an_origin(browser: Browser, file: Path) -> None:
    """It works where MLflow shows it: without an origin, storage and other files are barred."""
    browser.console.clear()
    encoded = base64.b64encode(file.read_bytes()).decode()
    browser.open(f"data:text/html;base64,{encoded}")
    assert browser.run("self.origin") == "null"
    seek(browser, 1000)
    assert browser.run(STATE) == expected(recorded(), 1000)
    assert browser.console == []


MARKUP = (
    "<img src=x onerror='window.hit = 1'>",
    "</script><script>window.hit = 1</script>",
    '"\'><svg onload="window.hit = 1">',
    "{{data}} <!-- ${window.hit = 1} &lt;b&gt;",
)


@pytest.mark.parametrize("bad", MARKUP)
def test_hostile_words_do_nothing(browser: Browser, tmp_path: Path, bad: str) -> None:
    """The page shows any name of a domain as text and runs none of it."""
    schema = small().schema
    style = dataclasses.replace(schema.styles["robot"], meaning=bad)
    keys = {n: dataclasses.replace(k, meaning=bad) for n, k in schema.vocabulary.keys.items()}
    actions = {n: dataclasses.replace(a, meaning=bad) for n, a in schema.vocabulary.actions.items()}
    vocabulary = dataclasses.replace(schema.vocabulary, keys=keys, actions=actions)
    schema = dataclasses.replace(
        schema,
        vocabulary=vocabulary,
        styles={"robot": style},
        components={"going": bad, "unused": bad},
    )
    scenes = [Scene((0, 0, 9, 9), movers=(Shape("robot", 1, 1, 1, bad),))]
    path = tmp_path / "hostile.html"
    path.write_text(page(small(scenes=scenes, schema=schema), title=bad), encoding="utf-8")
    browser.console.clear()
    browser.open(f"file://{path}")
    seek(browser, 5)
    assert browser.run("window.hit === undefined")
    assert browser.run("document.title") == bad
    assert bad in browser.run("document.getElementById('legend').textContent")
    assert browser.console == []


@pytest.mark.parametrize("bad", MARKUP)
def test_a_hostile_report_does_nothing(browser: Browser, tmp_path: Path, bad: str) -> None:
    """Nor does the page of `islandgp compare`, for any names of arms and runs."""
    arms = [fake_arm(name, [fake_run(path=name, seed=k)]) for k, name in enumerate((bad, "b"))]
    study = replace(compare_arms(arms, force=True), comparability_warnings=(bad,))
    report = build(study)
    report.tables["costs"] = DataFrame([{"a": bad, bad: "1"}])
    svg = f'<svg xmlns="http://www.w3.org/2000/svg"><text>{escape(bad)}</text></svg>'
    report.figures["curves"] = svg
    path = tmp_path / "report.html"
    path.write_text(report.files["index.html"], encoding="utf-8")
    browser.console.clear()
    browser.open(f"file://{path}")
    assert browser.run("window.hit === undefined")
    assert bad in browser.run("document.title")
    assert browser.run("document.body.innerText").count(bad.split()[0]) >= 5
    assert browser.console == []


# How many strokes on canvases, and changes of elements below #tree and outside of it, each of some
# frames takes, as [[strokes, in the tree, elsewhere], ...].
WORK = """
(async () => {
  const kind = CanvasRenderingContext2D.prototype;
  const names = ["stroke", "fill", "fillRect", "strokeRect", "fillText", "drawImage", "lineTo"];
  let strokes = 0, inTree = 0, elsewhere = 0;
  for (const name of names) {
    const before = kind[name];
    kind[name] = function (...all) { strokes += 1; return before.apply(this, all); };
  }
  const tree = document.querySelector("#tree");
  const count = all => { for (const one of all)
    if (tree.contains(one.target)) inTree += 1; else elsewhere += 1; };
  const watch = new MutationObserver(count);
  watch.observe(document, {subtree: true, childList: true, attributes: true, characterData: true});
  const found = [];
  for (const tick of TICKS) {
    player.seek(tick);
    await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)));
    count(watch.takeRecords());
    found.push([strokes, inTree, elsewhere]);
    strokes = inTree = elsewhere = 0;
  }
  return found;
})()
"""


@pytest.mark.slow
def test_a_frame_takes_little_work(browser: Browser, tmp_path: Path) -> None:
    """With a tree of 50 nodes: nodes whose status stays are not touched, late frames cost no more.

    So many strokes and changes fit into a sixtieth of a second many times.
    """
    recording = record(random_of_size(50), island(), seed=1, stage=3)
    path = tmp_path / "fifty.html"
    path.write_text(page(recording, title="fifty"), encoding="utf-8")
    browser.open(f"file://{path}")
    last = recording.ticks - 1
    early, late = range(100, 120), range(last - 20, last)
    work = browser.run(WORK.replace("TICKS", str([*early, *late])))
    for ticks, rows in ((early, work[: len(early)]), (late, work[len(early) :])):
        # The first frame of each stretch draws backdrops.
        for (one, other), (strokes, in_tree, elsewhere) in zip(
            pairwise(ticks), rows[1:], strict=True
        ):
            before, after = expected(recording, one), expected(recording, other)
            changed = sum(a != b for a, b in zip(before, after, strict=True))
            assert in_tree <= 4 * changed, (one, other)
            assert elsewhere <= 30, (one, other)
            assert strokes <= 500, (one, other)


def test_no_limit_of_nodes(browser: Browser, tmp_path: Path) -> None:
    """A tree of a thousand nodes is drawn, lit and can be stepped through."""
    tree = random_of_size(50)
    tree = tree._replace(kind="selector", args=(), children=tree.children * (1000 // 40))
    recording = record(tree, island(length=5), seed=1, stage=3)
    path = tmp_path / "large.html"
    path.write_text(page(recording, title="large"), encoding="utf-8")
    browser.console.clear()
    browser.open(f"file://{path}")
    seek(browser, 3)
    assert len(expected(recording, 3)) > 1000
    assert browser.run(STATE) == expected(recording, 3)
    assert browser.console == []


# Pairs of elements of which one lies upon the other.
OVERLAPPING = (
    "(parts => parts.flatMap((one, i) => parts.slice(i + 1).filter(other => {"
    " const [a, b] = [one, other].map(e => document.querySelector(e).getBoundingClientRect());"
    " return a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 1"
    " && b.top < a.bottom - 1; }).map(other => [one, other])))(PARTS)"
)
LABELS = "11.5 * document.getElementById('nodes').getCTM().a"  # px, of a node's label
SIZES = [(400, 800), (800, 600), (1024, 600), (1500, 900)]


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_any_size_of_window(
    browser: Browser, file: Path, sized: Callable[[int, int], None], width: int, height: int
) -> None:
    """Time runs to the right, the whole tree has room, and nothing makes the page too wide."""
    sized(width, height)
    browser.open(f"file://{file}")
    browser.run(DRAWN)
    first, last, wide = browser.run(
        f"[timeline.place(0), timeline.place({recorded().ticks - 1}), timeline.canvas.clientWidth]"
    )
    assert 0 < first < 0.4 * wide
    assert 0.8 * wide < last <= wide
    room, tree = browser.run(
        "['#tree-box', '#nodes'].map(name => (b => [b.left, b.top, b.right, b.bottom])"
        "(document.querySelector(name).getBoundingClientRect()))"
    )
    assert room[0] <= tree[0] < tree[2] <= room[2] + 1
    if width > 640:
        assert room[1] <= tree[1] < tree[3] <= room[3] + 1
    for canvas in ("scene", "chart", "timeline"):
        box = browser.run(
            f"(c => [c.clientWidth, c.clientHeight])(document.getElementById('{canvas}'))"
        )
        assert min(box) >= 60, canvas
    assert browser.run("document.documentElement.scrollWidth <= innerWidth")
    assert browser.run(LABELS) >= 10
    for parts in (
        ("h1", "#facts", "#score", "#map", "#mind", "#blackboard", "#fitness"),
        (".tools", "#scene", "#legend"),
        ("#why", "#tree-box", ".key"),
        ("#chart", "#shares"),
        ("#start", "#back", "#play", "#forth", "#clock", "#speed", "#help", ".lanes"),
    ):
        assert browser.run(OVERLAPPING.replace("PARTS", str(list(parts)))) == []


@pytest.mark.parametrize(("width", "height"), SIZES[:2])
def test_a_large_tree_on_a_small_screen(
    browser: Browser,
    tmp_path: Path,
    sized: Callable[[int, int], None],
    width: int,
    height: int,
) -> None:
    """It is an outline in letters of 10 px or more, and what runs moves into sight."""
    sized(width, height)
    recording = record(random_of_size(50), island(length=20), seed=1, stage=3)
    path = tmp_path / "large.html"
    path.write_text(page(recording, title="large"), encoding="utf-8")
    browser.console.clear()
    browser.open(f"file://{path}")
    seek(browser, 30)
    assert browser.run(LABELS) >= 10
    assert browser.run("document.documentElement.scrollWidth <= innerWidth")
    room, *running = browser.run(
        "[...document.querySelectorAll('#tree-box, .node.action.r > path')]"
        ".map(e => e.getBoundingClientRect()).map(b => [b.left, b.top, b.right, b.bottom])"
    )
    assert running
    left, top, right, bottom = running[-1]
    assert room[0] <= left < right <= room[2] + 1
    assert room[1] <= top < bottom <= room[3] + 1
    rows = browser.run("[...document.querySelectorAll('.node')].map(n => n.getCTM().f)")
    assert rows == sorted(set(rows))
    assert browser.console == []


def open_small(browser: Browser, folder: Path, **changes: Any) -> None:
    """Opens the page of an episode of the small domain."""
    path = folder / "small.html"
    path.write_text(page(small(**changes), title="small"), encoding="utf-8")
    browser.console.clear()
    browser.open(f"file://{path}")


def test_a_domain_that_draws_nothing(browser: Browser, tmp_path: Path) -> None:
    """The place of the world goes to the tree, and every key still does what it can."""
    open_small(browser, tmp_path)
    for key in ("f", "0", "+", "-", " ", "End"):
        browser.press(key)
    seek(browser, 19)
    assert browser.run("document.getElementById('map')") is None
    wide = browser.run("document.getElementById('mind').clientWidth / innerWidth")
    assert wide > 0.9
    assert browser.run("document.getElementById('score').textContent") == "5.00 points"
    entries = browser.run("[...document.querySelectorAll('.entry b')].map(b => b.textContent)")
    assert entries == ["yes", "19"]
    assert browser.console == []


def test_one_tick(browser: Browser, tmp_path: Path) -> None:
    """An episode of a single tick has a page as well."""
    open_small(browser, tmp_path, ticks=1, silent=True)
    browser.press(" ")
    browser.run(DRAWN)
    assert browser.run(STATE) == "rr"
    assert browser.console == []


@pytest.mark.parametrize("shape", ["circle", "ring", "square", "triangle", "diamond", "cross"])
def test_every_shape_is_drawn(browser: Browser, tmp_path: Path, shape: Any) -> None:
    """A shape is at its coordinates, y upwards, in its colour; the legend has its meaning."""
    schema = small().schema
    forms = {**schema.styles, "robot": ShapeStyle("my robot", "R", shape, "#ff00ff")}
    schema = dataclasses.replace(schema, styles=forms)
    scenes = [Scene((0, 0, 20, 10), movers=(Shape("robot", 18, 9, 0.8),))]
    open_small(browser, tmp_path, scenes=scenes, schema=schema)
    seek(browser, 18)
    at = browser.run(
        "(c => { const {data, width, height} = c.getContext('2d').getImageData(0, 0, c.width,"
        " c.height); let x = 0, y = 0, n = 0; for (let i = 0; i < data.length; i += 4)"
        " if (data[i] > 180 && data[i + 1] < 200 && data[i + 2] > 180 &&"
        " data[i] - data[i + 1] > 40) { x += i / 4 % width; y += Math.floor(i / 4 / width); n++; }"
        " return [x / n / width, y / n / height, n]; })(scene.canvas)"
    )
    assert at[0] > 0.8
    assert at[1] < 0.4
    assert at[2] > 20
    assert "my robot" in browser.run("document.getElementById('legend').textContent")
    assert browser.console == []


def png(size: int, colour: tuple[int, int, int]) -> bytes:
    """A square picture of one colour."""
    rows = (b"\0" + bytes(colour) * size) * size
    head = struct.pack(">IIBBBBB", size, size, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", head), (b"IDAT", zlib.compress(rows)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )


@pytest.mark.parametrize("bounds", [(0, 0, 8, 8), (0, 0, 0, 0)])
def test_pictures_of_a_simulator(
    browser: Browser, tmp_path: Path, bounds: tuple[float, float, float, float]
) -> None:
    """Where a domain gives pictures, the one of the tick is shown."""
    pictures = [png(8, (200, 0, 0)), png(8, (0, 0, 200))]
    scenes = [Scene(bounds, frame=partial(bytes, pictures[tick // 10])) for tick in range(20)]
    open_small(browser, tmp_path, scenes=scenes)
    browser.run("new Promise(done => setTimeout(() => done(1), 200))")
    for tick, colour in ((3, [200, 0, 0]), (15, [0, 0, 200])):
        seek(browser, tick)
        middle = (
            "(c => [...c.getContext('2d').getImageData(c.width / 2, c.height / 2, 1, 1)"
            ".data].slice(0, 3))(scene.canvas)"
        )
        assert browser.run(middle) == colour
    assert browser.run("document.getElementById('follow')") is None
    assert [line for line in browser.console if "readback" not in line] == []  # by this test


def test_many_actions_scroll(browser: Browser, tmp_path: Path) -> None:
    """Forty lanes have names that can be read, in a box that leaves room for the rest."""
    schema = small().schema
    actions = {f"Action{i}": schema.vocabulary.actions["Stay"] for i in range(40)}
    vocabulary = dataclasses.replace(
        schema.vocabulary, actions={**schema.vocabulary.actions, **actions}
    )
    recording = small(schema=dataclasses.replace(schema, vocabulary=vocabulary))
    tree = recording.tree._replace(children=tuple(leaf(name) for name in ("Go", *actions)))
    statuses = (recording.statuses[0], *[recording.statuses[1]] * 41)
    recording = dataclasses.replace(recording, tree=tree, statuses=statuses)
    path = tmp_path / "many.html"
    path.write_text(page(recording, title="many"), encoding="utf-8")
    browser.open(f"file://{path}")
    lanes, box, window = browser.run(
        "[timeline.canvas.clientHeight, timeline.canvas.parentElement.clientHeight, innerHeight]"
    )
    assert lanes > 41 * 12
    assert box < 0.35 * window
