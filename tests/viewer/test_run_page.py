"""The page of a run: its content, its handling of hostile text, and how it works in a browser."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from islandgp.gp.archive import Elite
from islandgp.records.archive_file import NAME, best_first
from islandgp.records.folder import RunFolder, Status
from islandgp.running.report import report
from islandgp.scoring.classes import Classes
from islandgp.viewer.history import RunRecords, nothing_works, read_history, thinned
from islandgp.viewer.run_page import run_page
from tests.composed import plain
from tests.evolution.runs import SMALL, run
from tests.records.listed import add_to_manifest
from tests.viewer.browser import Browser
from tests.viewer.runs import changed_record, closed_run
from tests.viewer.test_access import faint

DRAWN = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))"
EVIL = '</script><script>alert(1)</script><img src=x onerror=alert(2)>"&'


class Parsed(HTMLParser):
    """A page's scripts by id, its text outside of them, and its elements."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.scripts: list[tuple[str | None, str]] = []
        self.texts: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self._in = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Notes an element."""
        self.elements.append((tag, dict(attrs)))
        if tag in ("script", "style"):
            self._in = tag
            if tag == "script":
                self.scripts.append((dict(attrs).get("id"), ""))

    def handle_endtag(self, tag: str) -> None:
        """A script or a style is over."""
        if tag == self._in:
            self._in = ""

    def handle_data(self, data: str) -> None:
        """Keeps text where it belongs."""
        if self._in == "script":
            name, before = self.scripts[-1]
            self.scripts[-1] = (name, before + data)
        elif not self._in:
            self.texts.append(data)

    @property
    def text(self) -> str:
        """What a reader sees without JavaScript, blanks joined."""
        return " ".join(" ".join(self.texts).split())

    @property
    def data(self) -> Any:
        """What the page's script reads."""
        return json.loads(dict(self.scripts)["data"])


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """A finished run's folder; nobody changes it."""
    return closed_run(tmp_path_factory.mktemp("runs") / "run")


@pytest.fixture(scope="module")
def page(finished: RunFolder) -> Parsed:
    """Its page."""
    return Parsed(run_page(finished, Status.FINISHED, replay="<p>replay</p>", now=1))


def test_the_result_in_a_sentence(page: Parsed) -> None:
    """Mean, interval, difference to the reference tree and tiers in worlds without training."""
    assert ": 12,345 points (95 %: 10,000 to 14,000) in 3 unseen worlds, " in page.text
    assert ", -500 points (95 %: -900 to -100) against the tree all_rounder." in page.text
    assert "In these worlds it is Complete in 67%." in page.text
    assert "The run had 8 generations and 96 episodes." in page.text


def test_a_run_in_which_nothing_works(tmp_path: Path) -> None:
    """The summary and the page say what no individual has achieved, with remedies."""
    classes = Classes.model_validate(plain(*SMALL)["classes"])
    history = read_history(closed_run(tmp_path / "run"))
    assert nothing_works(history, classes) == ""
    for snapshot in history.snapshots:
        snapshot["tiers"] = dict.fromkeys(snapshot["tiers"], 0)
    name = next(n for n, counter in classes.behaviours.items() if counter == "deliveries")
    history.counted.discard("deliveries")
    said = nothing_works(history, classes)
    assert said.startswith("No individual has ever reached a tier (Excellent, Complete, ")
    assert f" or shown a behaviour ({name}) in 96 episodes: start from" in said
    history.counted.clear()
    assert "or shown a behaviour (" in nothing_works(history, classes)
    folder = RunFolder(tmp_path / "run")
    summary = {**folder.summary(), "nothing_works": said}
    (folder.path / "summary.json").write_text(json.dumps(summary))
    add_to_manifest(folder.path, "summary.json")
    folder = RunFolder(folder.path)
    assert said in Parsed(run_page(folder, Status.FINISHED)).text
    assert said in report(folder, [])


def test_curves_are_the_records(finished: RunFolder, page: Parsed) -> None:
    """Fitness, tiers, coverage and QD score against episodes, and where stages begin."""
    records, curves = list(finished.records()), page.data["curves"]
    assert curves["episodes"] == [12 * (g + 1) for g in range(8)]
    assert curves["fitness_max"] == [r["snapshot"]["fitness_max"] for r in records]
    assert curves["fitness_mean"] == [r["snapshot"]["fitness_mean"] for r in records]
    assert curves["coverage"] == [r["archive"]["coverage"] for r in records]
    assert curves["qd_score"] == [r["archive"]["qd_score"] for r in records]
    assert curves["tiers"]["complete"] == [r["snapshot"]["tiers"]["complete"] / 12 for r in records]
    assert curves["stages"] == [[12, 1]]
    assert curves["best_of_stage"] == [max(curves["fitness_max"][: g + 1]) for g in range(8)]


def test_the_best_so_far_is_that_of_the_stage() -> None:
    """Points of two stages are not compared."""
    history = RunRecords({})
    cost = {"episodes": 1, "evaluation": 0, "supervision": 0, "operators": 0}
    for stage, best in ((0, 5.0), (0, 3.0), (1, 2.0), (1, 4.0)):
        record = {
            "snapshot": {"stage": stage, "fitness_mean": 0.0, "tiers": {}},
            "individuals": [{"fitness": best, "tree": "", "components": {}, "counters": {}}],
            "worlds": [],
            "guidance": None,
            "archive": {"coverage": 0.0, "qd_score": 0.0},
        }
        history.add(record, cost)
    curves = thinned(history)
    assert (curves["best_of_stage"], curves["stages"]) == ([5, 5, 2, 4], [[1, 1], [3, 2]])
    assert history.fittest is not None
    assert history.fittest["fitness"] == 4.0


def test_the_map_is_the_archive(finished: RunFolder, page: Parsed) -> None:
    """Every elite with its tree, best first; axes with their edges."""
    archive = finished.archive()
    archive_data = page.data["archive"]
    assert [axis["name"] for axis in archive_data["axes"]] == list(archive.cells)
    assert [tuple(e["cell"]) for e in archive_data["elites"]] == [
        e.cell for e in best_first(archive.elites)
    ]
    assert {e["tree"] for e in archive_data["elites"]} == {e.tree for e in archive.elites}
    assert archive_data["domain"] == "island"
    assert archive_data["command"].endswith(" replay - --run run")


def test_the_champion_and_how_it_came_to_be(finished: RunFolder, page: Parsed) -> None:
    """Its tree as a picture and as text, a command for its replay, and each of its ancestors."""
    best = finished.summary()["champion"]["record"]
    assert " ".join(best["tree"].split()) in page.text
    rows = [a for _, a in page.elements if (a.get("class") or "").startswith("node ")]
    assert len(rows) == best["nodes"]
    worlds = list(finished.records())[finished.summary()["champion"]["generation"]]["worlds"]
    assert f"replay run --seed {worlds[0]} --stage 1" in page.text
    steps = sum(tag == "li" for tag, _ in page.elements) - best["nodes"]
    assert steps >= 1
    assert f"{steps} trees in" in page.text or "in one step" in page.text


def test_the_page_needs_no_other_file(page: Parsed) -> None:
    """No element names another file, and there are the page's three scripts only."""
    assert [name for name, _ in page.scripts] == ["data", "replay", None]
    for tag, attributes in page.elements:
        assert tag not in ("link", "img", "iframe", "object")
        assert not {"src", "href"} & attributes.keys(), (tag, attributes)


@pytest.mark.parametrize("status", list(Status))
def test_it_loads_itself_again_while_the_run_goes_on(tmp_path: Path, status: Status) -> None:
    """Without JavaScript too; and its body has the status."""
    folder = closed_run(tmp_path / "run", steps=run()[:3], complete=False)
    if status is Status.FINISHED:
        folder = closed_run(tmp_path / "other")
    parsed = Parsed(run_page(folder, status))
    reloads = ("meta", {"http-equiv": "refresh", "content": "5"}) in parsed.elements
    assert reloads is (status is Status.RUNNING)
    assert ("body", {"data-status": status.value}) in parsed.elements


def test_a_run_that_goes_on(tmp_path: Path) -> None:
    """It has the progress of the run, and the archive of its last generation."""
    steps = run()[:3]
    parsed = Parsed(
        run_page(closed_run(tmp_path / "run", steps=steps, complete=False), Status.RUNNING)
    )
    assert "After 3 of 8 generations, 36 episodes, the fittest individual of this" in parsed.text
    expected = sorted(e.cell for e in steps[-1].archive)
    assert sorted(tuple(e["cell"]) for e in parsed.data["archive"]["elites"]) == expected


def test_a_run_that_has_just_begun(tmp_path: Path) -> None:
    """Before the first generation there is a page, too."""
    folder = closed_run(tmp_path / "run", steps=[], complete=False)
    parsed = Parsed(run_page(folder, Status.RUNNING))
    assert "its first generation is not evaluated yet" in parsed.text
    assert parsed.data["curves"]["episodes"] == []


def test_a_run_that_failed_or_was_stopped(tmp_path: Path) -> None:
    """The reason, or that its command goes on."""
    folder = closed_run(tmp_path / "run", steps=run()[:2], complete=False)
    assert "was stopped after 2 generations" in Parsed(run_page(folder, Status.KILLED)).text
    folder.fail(ValueError(EVIL))
    parsed = Parsed(run_page(folder, Status.FAILED))
    assert "failed after 2 generations and 24 episodes: ValueError: </script>" in parsed.text
    assert len(parsed.scripts) == 3


def test_an_archive_that_cannot_be_read(tmp_path: Path) -> None:
    """The page reports it, and has all the rest."""
    folder = closed_run(tmp_path / "run")
    (folder.path / NAME).write_text("{}")
    data = Parsed(run_page(folder, Status.FINISHED)).data
    assert (data["archive"]["readable"], data["archive"]["elites"]) == (False, [])


def test_hostile_text_stays_text(tmp_path: Path) -> None:
    """Names, reasons and files with markup never become elements."""
    folder = closed_run(
        tmp_path / "run",
        fields={"title": EVIL, "command": f"python -m islandgp {EVIL} 'world={EVIL}'",
              "tags": {"domain": EVIL, "code": EVIL}},
    )  # fmt: skip

    def poison(record: dict[str, Any]) -> None:
        for i in record["individuals"]:
            i.update(origin="injected", mutation=EVIL, parents=[])
            i["components"] = {EVIL: i["fitness"]}
        record["guidance"] = {
            **(record["guidance"] or {"asked_at": None}),
            "source": EVIL, "target": EVIL, "rationale": EVIL,
        }  # fmt: skip
        record["snapshot"]["tiers"] = {EVIL: 1}

    records = list(folder.records())
    for generation in range(8):
        changed_record(folder, generation, lambda r: poison(r) if r["guidance"] else None)
    summary = folder.summary()
    summary["champion"]["record"] = {
        **records[3]["individuals"][0], "components": {EVIL: 1.0}, "counters": {EVIL: 1.0},
    }  # fmt: skip
    (folder.path / "summary.json").write_text(json.dumps(summary))
    add_to_manifest(folder.path, "summary.json")
    text = run_page(folder, Status.FINISHED, replay=EVIL)
    parsed = Parsed(text)
    assert [name for name, _ in parsed.scripts] == ["data", "replay", None]
    assert not any(tag == "img" for tag, _ in parsed.elements)
    assert json.loads(dict(parsed.scripts)["replay"]) == EVIL
    assert parsed.data["archive"]["domain"] == EVIL
    assert EVIL in "".join(parsed.texts)


def test_a_long_run_has_a_page_of_some_size(tmp_path: Path) -> None:
    """Curves are thinned, trees beyond the room are left out, a large replay as well."""
    history = read_history(closed_run(tmp_path / "run"))
    cost = {"episodes": 1, "evaluation": 0, "supervision": 0, "operators": 0}
    record = next(RunFolder(tmp_path / "run").records())
    for _ in range(2_000):
        history.add(record, cost)
    curves = thinned(history)
    assert {len(curves[name]) for name in ("episodes", "fitness_max", "best_of_stage")} == {300}
    assert curves["episodes"][-1] == 96 + 2_000
    assert curves["best_of_stage"][-1] == max(row["fitness_max"] for row in history.curves)
    folder = closed_run(tmp_path / "many")
    trees = ["PatrolWaypoint\n" + "# " + "x" * 500 for _ in range(6**4)]
    elites = tuple(
        Elite((k // 216, k // 36 % 6, k // 6 % 6, k % 6), f"0.{k}", tree, 0, 1, float(k), 1)
        for k, tree in enumerate(trees)
    )
    archive = folder.archive()
    (folder.path / NAME).write_bytes(replace(archive, elites=elites).to_bytes())
    add_to_manifest(folder.path, NAME)
    text = run_page(folder, Status.FINISHED, replay="x" * 1_000_000)
    parsed = Parsed(text)
    elite_rows = parsed.data["archive"]["elites"]
    assert len(text.encode()) < 2_000_000
    assert len(elite_rows) == 6**4
    assert [e["tree"] is None for e in elite_rows] == sorted(e["tree"] is None for e in elite_rows)
    assert elite_rows[0]["tree"] is not None
    assert elite_rows[-1]["tree"] is None
    assert json.loads(dict(parsed.scripts)["replay"]) == ""


@pytest.fixture(scope="module")
def file(finished: RunFolder, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page as a file."""
    path = tmp_path_factory.mktemp("page") / "run.html"
    path.write_text(run_page(finished, Status.FINISHED, replay="<h1>It plays</h1>", now=1))
    return path


@pytest.fixture
def tab(browser: Browser, file: Path) -> Iterator[Browser]:
    """The page, just opened; fails where the browser complained about anything."""
    browser.console.clear()
    browser.open(f"file://{file}")
    browser.run("document.querySelectorAll('main > details').forEach(d => d.open = true)")
    browser.run(DRAWN)
    yield browser
    browser.run("1")
    assert browser.console == []


def test_in_a_browser_all_parts_are_drawn(tab: Browser, finished: RunFolder) -> None:
    """A line per curve, a cell per pair of counters with an elite, the replay beside the tree."""
    elites = finished.archive().elites
    assert tab.run("document.querySelectorAll('#map .elite').length") == len(
        {e.cell[:2] for e in elites}
    )
    assert tab.run("document.querySelectorAll('#fitness .line').length") == 2
    assert tab.run("document.querySelectorAll('#tiers .line').length") == 4
    names = tab.run("[...document.querySelectorAll('.chart')].map(e => e.ariaLabel)")
    assert names[0].startswith("Fitness, points, over 96 episodes: best of a generation ends at ")


def test_a_reader_chooses_the_counters_of_the_map(tab: Browser, finished: RunFolder) -> None:
    """Both axes have their counter's name and edges; a cell has the best of its elites."""
    archive = finished.archive()
    names = [*archive.cells]
    assert tab.run("[...document.querySelectorAll('#across option')].map(o => o.text)") == names
    for name, axis in (("across", 3), ("up", 2)):
        tab.run(
            f"(() => {{ const s = document.getElementById('{name}'); s.value = '{axis}';"
            " s.dispatchEvent(new Event('change')); return 1; })()"
        )
    texts = tab.run("[...document.querySelectorAll('#map text')].map(t => t.textContent)")
    assert {f"{names[3]}, from", f"{names[2]}, from"} <= {*texts}
    best: dict[tuple[int, ...], float] = {}
    for e in archive.elites:
        best[e.cell[2:4]] = max(e.mean, best.get(e.cell[2:4], e.mean))
    titles = tab.run("[...document.querySelectorAll('#map .elite title')].map(t => t.textContent)")
    assert len(titles) == len(best)


def test_the_front_is_a_picture(browser: Browser, tmp_path: Path) -> None:
    """A dot per tree with its interval; a size shows its tree, the best robot first."""
    folder = closed_run(tmp_path / "run")
    summary = folder.summary()
    difference = {"name": "the longest tree", "mean": -3.0, "low": -5.0, "high": -1.0}
    summary["champion"]["front"] = [
        {"nodes": 1, "tree": "PatrolWaypoint\n", "difference": difference, "chosen": True},
        {"nodes": 2, "tree": "invert { PatrolWaypoint }\n", "difference": None, "chosen": False},
    ]
    (folder.path / "summary.json").write_text(json.dumps(summary))
    add_to_manifest(folder.path, "summary.json")
    file = tmp_path / "run.html"
    file.write_text(run_page(RunFolder(folder.path), Status.FINISHED, now=1))
    browser.open(f"file://{file}")
    browser.run("document.getElementById('front').open = true")
    browser.run(DRAWN)
    dots = "[...document.querySelectorAll('#front-chart circle title')].map(t => t.textContent)"
    assert browser.run(dots) == ["1 nodes, -3 [-5, -1]", "2 nodes, +0 [+0, +0]"]
    assert browser.run("document.getElementById('front-tree').textContent") == "PatrolWaypoint\n"


def test_the_tree_has_its_explanation(tmp_path: Path) -> None:
    """Each node has its share of worlds, its points, and what is lost without it."""
    folder = closed_run(tmp_path / "run")
    summary = folder.summary()
    ticks = dict.fromkeys(("ticks", "successes", "failures", "aborts"), 1.0)
    loss = {"mean": 7.0, "low": -1.0, "high": 15.0}
    usage = {**ticks, "worlds": 0.5, "points": 1234.0, "loss": loss}
    idle = {**ticks, "worlds": 0.0, "points": 0.0, "loss": None}
    summary["champion"].update(
        tree="sequence { PatrolWaypoint MoveToGarbage }\n", usage=[usage, idle, usage]
    )
    (folder.path / "summary.json").write_text(json.dumps(summary))
    add_to_manifest(folder.path, "summary.json")
    text = Parsed(run_page(RunFolder(folder.path), Status.FINISHED)).text
    assert "sequence 50% 1,234 -7 [-15, +1]" in text
    assert "PatrolWaypoint never runs" in text
    assert "MoveToGarbage 50% 1,234 -7 [-15, +1]" in text


def test_a_cell_opens_its_tree(tab: Browser, finished: RunFolder) -> None:
    """By a click, by the list, and by arrow keys from elite to elite."""
    elites = best_first(finished.archive().elites)
    tree = "document.querySelector('#cell pre').textContent"
    assert tab.run(tree) == elites[0].tree
    tab.run(
        "(() => { const s = document.getElementById('cells'); s.value = '1';"
        " s.dispatchEvent(new Event('change')); return 1; })()"
    )
    assert tab.run(tree) == elites[1].tree
    assert tab.run("location.hash") == "#cell-" + "-".join(map(str, elites[1].cell))
    tab.run("document.getElementById('map').focus()")
    trees = set()
    for key in ("ArrowLeft", "ArrowUp", "ArrowRight", "ArrowDown") * 4:
        tab.press(key)
        trees.add(tab.run(tree))
    assert len(trees) > 1
    assert trees <= {e.tree for e in elites}
    box = tab.run(
        "(() => { document.getElementById('map').scrollIntoView({block: 'center'});"
        " const all = [...document.querySelectorAll('#map .elite')];"
        " const r = all[2].getBoundingClientRect();"
        " return [r.x + r.width / 2, r.y + r.height / 2]; })()"
    )
    tab.click(*box)
    assert tab.run(tree) in {e.tree for e in elites}
    assert tab.run("location.hash") != ""
    assert tab.run("document.querySelectorAll('#map .chosen').length") == 1


@pytest.mark.process
def test_the_command_of_a_cell_plays_its_tree(tab: Browser, tmp_path: Path) -> None:
    """As a shell takes it: the tree comes by the standard input, whole."""
    command = tab.run("document.querySelectorAll('#cell pre')[1].textContent")
    program, _, rest = command.partition(" replay - ")
    assert program
    output = subprocess.run(
        ["bash", "-c", f"printf '%s ' cat; cat {rest[rest.index('<<') :]}"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    tree = tab.run("document.querySelector('#cell pre').textContent")
    assert output == f"cat domain island\n\n{tree}"
    assert rest.startswith("--run run --seed ")
    assert " -o cell.html <<" in rest


def test_the_replay_opens_in_the_page(tab: Browser) -> None:
    """On demand, in a frame that may run scripts and nothing else."""
    frame = "document.querySelector('iframe')"
    assert tab.run(f"{frame}.getAttribute('sandbox')") == "allow-scripts"
    assert tab.run(f"{frame}.srcdoc") == "<h1>It plays</h1>"


@pytest.mark.parametrize("width", [1500, 800, 400])
def test_the_page_fits_into_the_window(
    tab: Browser, file: Path, sized: Callable[[int, int], None], width: int
) -> None:
    """The page scrolls down, never sideways."""
    sized(width, 900)
    tab.open(f"file://{file}")
    assert tab.run("document.documentElement.scrollWidth") <= width


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_every_text_can_be_read(tab: Browser, file: Path, theme: str) -> None:
    """In both colours a text has a contrast of 4.5 to its background (WCAG AA)."""
    wish = {"name": "prefers-color-scheme", "value": theme}
    tab.call("Emulation.setEmulatedMedia", features=[wish])
    try:
        tab.open(f"file://{file}")
        tab.run("document.querySelectorAll('details').forEach(d => d.open = true)")
        # Their texts are all of one colour, soft upon panel, which the replay page has as well.
        tab.run(
            "document.head.append(Object.assign(document.createElement('style'),"
            " {textContent: '.chart, #map { visibility: hidden }'})), 1"
        )
        assert faint(tab) == []
    finally:
        tab.call("Emulation.setEmulatedMedia", features=[])


def test_a_running_page_can_be_stopped(browser: Browser, tmp_path: Path) -> None:
    """It offers to pause its updates, and keeps the cell that was chosen."""
    folder = closed_run(tmp_path / "run", steps=run()[:4], complete=False)
    file = tmp_path / "run.html"
    file.write_text(run_page(folder, Status.RUNNING, now=1))
    browser.open(f"file://{file}")
    assert browser.run("document.getElementById('pause').hidden") is False
    browser.run("document.getElementById('pause').click()")
    assert browser.run("document.getElementById('pause').textContent") == "updates are paused"
    assert "is the run still at work?" in browser.run("document.body.textContent")
    elites = browser.run("run.archive.elites.map(e => e.cell.join('-'))")
    browser.open(f"file://{file}#cell-{elites[-1]}")
    assert browser.run("document.getElementById('cells').value") == str(len(elites) - 1)
