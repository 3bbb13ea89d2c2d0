"""The replay page in a real browser: it plays, scrubs, and shows what happened."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from islandgp.bt.node import KEYS, walk
from islandgp.viewer.page import page
from islandgp.viewer.recording import IDLE, Recording, record
from tests.composed import composed
from tests.viewer.browser import Browser, chromium
from tests.viewer.episodes import random_of_size, recorded

LETTERS = ".fsrx"
STATE = (
    "[...document.querySelectorAll('#tree .node')]"
    ".map(n => ['f','s','r','x'].find(c => n.classList.contains(c)) ?? '.').join('')"
)
DRAWN = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))"


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """One Chromium for all tests here."""
    program = chromium()
    if program is None:
        pytest.skip("no Chromium is installed (apt-get install chromium)")
    with Browser(program, tmp_path_factory.mktemp("profile")) as opened:
        yield opened


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of the all-rounder's episode."""
    path = tmp_path_factory.mktemp("page") / "replay.html"
    path.write_text(page(recorded(), title="All-rounder"), encoding="utf-8")
    return path


@pytest.fixture
def opened(browser: Browser, file: Path) -> Iterator[Browser]:
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


def test_right_nodes_are_lit(opened: Browser) -> None:
    """At any time exactly the nodes are lit that did something in that tick, in its colour."""
    recording = recorded()
    for tick in (0, 1, 115, 116, 142, 143, 1000, 2222, 3333, recording.ticks - 1):
        seek(opened, tick)
        assert opened.run(STATE) == expected(recording, tick), tick


def test_address_says_where_to_begin(browser: Browser, file: Path) -> None:
    """replay.html#t=96.6 opens at that second."""
    browser.open(f"file://{file}#t=96.6")
    assert browser.run("document.getElementById('clock').textContent") == "96.6 s"
    assert browser.run(STATE) == expected(recorded(), 966)


def test_blackboard_and_fitness(opened: Browser) -> None:
    """Beside the tree stand the blackboard and the points of that tick."""
    recording = recorded()
    seek(opened, 2000)
    shown = opened.run("[...document.querySelectorAll('.entry b')].map(b => b.textContent)")
    battery, room, lap, garbage, humanoid = recording.boards[2000]
    assert shown == [
        f"{battery:.1f} %",
        f"{room:g}",
        f"{lap:g}",
        "yes" if garbage else "no",
        "yes" if humanoid else "no",
    ]
    assert len(shown) == len(KEYS)
    won = sum(c.points for c in recording.credits if c.tick <= 2000)
    text = opened.run("document.getElementById('score').textContent")
    assert text == f"{math.floor(won + 0.5):,} points"


def test_it_plays_and_pauses(opened: Browser) -> None:
    """Space plays: time passes at the chosen speed; space again stops it."""
    opened.run("player.speed(20)")
    opened.press(" ")
    tick = opened.run(
        "new Promise(done => { const began = performance.now(), look = () =>"
        " performance.now() - began > 500 ? done(player.state.tick) : requestAnimationFrame(look);"
        " look(); })"
    )
    assert 40 < tick < 160  # half a second at twenty times ten ticks a second is 100
    opened.press(" ")
    stopped = opened.run(f"{DRAWN}.then(() => player.state.tick)")
    assert opened.run(f"{DRAWN}.then(() => player.state.tick)") == stopped == int(stopped)


def test_it_ends(opened: Browser) -> None:
    """At the end it stops by itself, and playing again starts from the beginning."""
    last = recorded().ticks - 1
    opened.run(f"player.seek({last - 2}); player.speed(100); player.play(true)")
    opened.run(f"{DRAWN}.then(() => {DRAWN})")
    assert opened.run("[player.state.playing, player.state.tick]") == [False, last]
    opened.run(f"player.play(true); {DRAWN}")
    assert opened.run("player.state.tick") < 200


def test_keys(opened: Browser) -> None:
    """Arrows step, Home and End jump, brackets change the speed, comma and dot find decisions."""
    opened.press("ArrowRight")
    opened.press("ArrowRight")
    opened.press("ArrowLeft")
    assert opened.run("player.state.tick") == 1
    opened.press("End")
    assert opened.run("player.state.tick") == recorded().ticks - 1
    opened.press("Home")
    assert opened.run("player.state.tick") == 0
    opened.press("]")
    assert opened.run("document.getElementById('speed').value") == "20"
    opened.press(".")
    first = opened.run("player.state.tick")
    codes = [
        recorded().statuses[place]
        for place, node in enumerate(walk(recorded().tree))
        if node.kind == "action"
    ]
    assert any(line[first] != IDLE for line in codes)
    opened.press(",")
    assert opened.run("player.state.tick") == 0


def centre(browser: Browser, selector: str) -> Any:
    return browser.run(
        f"(b => [b.left + b.width / 2, b.top + b.height / 2])"
        f"(document.querySelector({selector!r}).getBoundingClientRect())"
    )


def test_scrubbing(opened: Browser) -> None:
    """A click in the middle of the timeline goes to the middle of the episode."""
    left, top, width = opened.run(
        "(b => [b.left, b.top, b.width])(timeline.canvas.getBoundingClientRect())"
    )
    x = left + 172 + (width - 172 - 18) / 2
    opened.click(x, top + 30)
    assert abs(opened.run("player.state.tick") - recorded().ticks / 2) < 10


def test_click_on_a_node_goes_to_its_next_start(opened: Browser) -> None:
    """A click on MoveToHumanoid shows the next time that it starts."""
    actions = [str(n.args[0]) if n.kind == "action" else "" for n in walk(recorded().tree)]
    place = actions.index("MoveToHumanoid")
    start = next(t for t, code in enumerate(recorded().statuses[place]) if code != IDLE)
    opened.click(*centre(opened, f"[data-place='{place}']"))
    assert opened.run(f"{DRAWN}.then(() => player.state.tick)") == start
    assert "MoveToHumanoid" in opened.run("document.getElementById('why').textContent")


def test_zoom(opened: Browser) -> None:
    """Plus zooms into the island, zero shows all of it again, F follows the robot."""
    before = opened.run("island.view.scale")
    opened.press("+")
    opened.run(DRAWN)
    assert opened.run("island.view.scale") > before
    opened.press("0")
    opened.run(DRAWN)
    assert opened.run("island.view.scale") == before
    seek(opened, 500)
    opened.press("f")
    opened.run(DRAWN)
    at = recorded().robot[500]
    x, y = opened.run("[island.view.x, island.view.y]")
    assert abs(complex(x, y) - at) < 0.2


def test_something_is_drawn(opened: Browser) -> None:
    """The canvases are not empty: each has many colours."""
    for canvas in ("island", "chart", "timeline"):
        colours = opened.run(
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


def test_fifty_nodes_at_sixty_frames(browser: Browser, tmp_path: Path) -> None:
    """With a tree of 50 nodes a frame is drawn well within a sixtieth of a second."""
    recording = record(random_of_size(50), composed(), seed=1, stage=3)
    path = tmp_path / "fifty.html"
    path.write_text(page(recording, title="fifty"), encoding="utf-8")
    browser.open(f"file://{path}#play=10")
    browser.run(
        "new Promise(done => { const look = () =>"
        " player.frames.length > 40 || !player.state.playing ? done(1)"
        " : requestAnimationFrame(look); look(); })"
    )
    drawing = sorted(took for _, took in browser.run("player.frames"))
    assert drawing[len(drawing) // 2] < 1000 / 60


def test_no_limit_of_nodes(browser: Browser, tmp_path: Path) -> None:
    """A tree of a thousand nodes is drawn, lit and can be stepped through."""
    tree = random_of_size(50)
    tree = tree._replace(kind="selector", args=(), children=tree.children * (1000 // 40))
    whole = composed()
    short = whole.world.episode.model_copy(update={"length": 5})
    settings = whole.model_copy(update={"world": whole.world.model_copy(update={"episode": short})})
    recording = record(tree, settings, seed=1, stage=3)
    path = tmp_path / "large.html"
    path.write_text(page(recording, title="large"), encoding="utf-8")
    browser.console.clear()
    browser.open(f"file://{path}")
    seek(browser, 3)
    assert len(expected(recording, 3)) > 1000
    assert browser.run(STATE) == expected(recording, 3)
    assert browser.console == []
