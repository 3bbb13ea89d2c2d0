"""docs/extending.md: its files, its changes and its commands, unchanged."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from islandgp.domains.island.vocabulary import SCHEMA
from islandgp.testing import check_domain
from tests.running.commands import ROOT, Command, in_process

pytestmark = pytest.mark.process

TEXT = (ROOT / "docs/extending.md").read_text(encoding="utf-8")
COPIED = ("islandgp", "conf", "grammar", "prompts", "tests", "pyproject.toml")
SMALL = ("gp.generations=3", "gp.population=12", "world.episode.length=20", "progress=off")
NEAR = ("--set", "world.waypoints=[[150,160],[150,140]]")
LAPS = "selector { when batteryLevel < 40 { SeekCharger } PatrolWaypoint }"
COLLECT = "selector { when robotCurrentExtraCapacity < 15 { DeliverToClearingPoint } %s }"
IN_A_PROCESS = """
import json, sys
from pathlib import Path
from islandgp.testing import check_domain
from tests.running.commands import in_process

check_domain.__kwdefaults__.update(random_trees=2)
say = in_process(Path.cwd())
print(json.dumps([say(*words) for words in json.loads(sys.argv[1])]))
"""


def blocks(kind: str, text: str = TEXT) -> list[str]:
    """The blocks ```KIND of the page."""
    return re.findall(rf"^```{kind}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def commands(kind: str) -> list[list[str]]:
    """The commands of the blocks ```KIND, as words."""
    return [shlex.split(line) for block in blocks(kind) for line in block.splitlines()]


def write_files(folder: Path) -> None:
    """The page's files, each under the name in its first line, or below its header."""
    for text in [*blocks("yaml"), *blocks("python")]:
        name = next(line for line in text.splitlines() if not line.startswith("# @"))
        path = folder / name.removeprefix("# ")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def arguments_of(command: list[str]) -> list[str]:
    """The arguments of `islandgp` in a command of the page, a run as a small one."""
    if command[0] == "islandgp":
        short = ("--set", "world.episode.length=20") if "--check" in command else ()
        return [*command[1:], *short]
    assert command[:3] == ["python", "-m", "islandgp"]
    return ["run", *command[3:], "evaluator=serial", *SMALL]


def in_a_process(folder: Path, *commands: list[str]) -> list[str]:
    """Runs commands with the package of a folder, in that folder; returns what each printed."""
    process = subprocess.run(
        [sys.executable, "-c", IN_A_PROCESS, json.dumps(commands)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, process.stdout + process.stderr
    outputs: list[str] = json.loads(process.stdout)
    return outputs


def records(folder: Path, run: str) -> Iterator[Any]:
    """The generations of the only run whose folder's name has `run` in it."""
    (file,) = folder.glob(f"runs/smoke/*{run}*/generations.jsonl")
    return (json.loads(line) for line in file.read_text(encoding="utf-8").splitlines())


PLAY = ("play", "tree.bt", "--set", "curriculum=flat", "--seeds", "2", "--json")


def played(run: Command, folder: Path, tree: str, *options: str) -> list[Any]:
    """A tree's outcomes in two worlds, without a multiplier."""
    (folder / "tree.bt").write_text(tree, encoding="utf-8")
    outcomes: list[Any] = json.loads(run(*PLAY, *options))
    return outcomes


@pytest.fixture(scope="module")
def outside(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the page's files, where each of its commands has been run."""
    folder = tmp_path_factory.mktemp("outside")
    write_files(folder)
    run = in_process(folder)
    page_commands = commands("sh")
    assert len(page_commands) == 8
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(check_domain.__kwdefaults__, "random_trees", 2)
        for command in page_commands:
            run(*arguments_of(command))
    return folder


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the checkout with the page's changes and files."""
    if shutil.which("git") is None:
        pytest.skip("git is not installed, and applies the changes")
    folder = tmp_path_factory.mktemp("checkout")
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name)
        else:
            shutil.copy(ROOT / name, folder / name)
    changes = blocks("diff")
    assert len(changes) == 1
    for change in changes:
        subprocess.run(["git", "apply", "-"], cwd=folder, input=change, text=True, check=True)
    write_files(folder)
    return folder


@pytest.mark.slow
def test_a_world(outside: Path) -> None:
    """The run's world is the pond: the values of the file, and otherwise the island's."""
    assert list(outside.glob("runs/smoke/*world=pond*/summary.json"))
    (file,) = outside.glob("runs/smoke/*world=pond*/config.yaml")
    text = file.read_text(encoding="utf-8")
    assert "side: 200" in text
    assert "capacity: 30" in text


@pytest.mark.slow
def test_a_reward(outside: Path) -> None:
    """A delivery earns the points of its band, a collision four times the penalty."""
    run = in_process(outside)
    tree = COLLECT % "sequence { MoveToGarbage PickupGarbage } PatrolWaypoint"
    careful = played(run, outside, tree, "--config-dir", "mine", "--set", "rewards=careful")
    paper = played(run, outside, tree)
    for a, b in zip(careful, paper, strict=True):
        assert a["counters"] == b["counters"]
        n = a["counters"]["deliveries"]
        assert n > 0
        assert a["components"]["delivery"] == 1500 * n
        assert a["components"]["collision"] == 4 * b["components"]["collision"]
        assert a["components"]["garbage"] == b["components"]["garbage"]
    assert list(outside.glob("runs/smoke/*rewards=careful*/summary.json"))
    assert list(outside.glob("runs/smoke/*collision.base=-1000*/summary.json"))


@pytest.mark.slow
def test_a_tier(outside: Path) -> None:
    """The tier is counted in each generation, and the first of it is looked for."""
    assert all("courier" in r["snapshot"]["tiers"] for r in records(outside, "classes=courier"))
    (file,) = outside.glob("runs/smoke/*classes=courier*/summary.json")
    assert list(json.loads(file.read_text(encoding="utf-8"))["first"]) == ["complete", "courier"]


@pytest.mark.slow
def test_a_supervisor(outside: Path) -> None:
    """Its rates are those of its rule."""
    rates = [r["guidance"]["wanted_rate"] for r in records(outside, "cooling-") if r["guidance"]]
    assert rates == [0.5, pytest.approx(0.3)]


@pytest.mark.slow
def test_a_supervisor_that_edits(outside: Path) -> None:
    """Its edited tree is in the next generation, with the branch in front."""
    history = list(records(outside, "recharging-"))
    (edit,) = history[0]["guidance"]["edits"]
    assert (edit["kind"], edit["refused"]) == ("front", "")
    (child,) = [i for i in history[1]["individuals"] if i["origin"] == "edited"]
    assert child["parents"] == [edit["of"]]
    assert child["tree"].startswith("selector {\n  when batteryLevel < 45 abort lower")
    assert [trial["id"] for trial in history[1]["trials"]] == [child["id"]]


@pytest.mark.slow
def test_operators(outside: Path) -> None:
    """The mutation changes trees, and the crossover and the selection make children."""
    hoisted, crossed = records(outside, "gp=hoisting"), records(outside, "operators_leaf")
    assert "operators:hoist" in {i["mutation"] for r in hoisted for i in r["individuals"]}
    assert "crossover" in {i["origin"] for r in crossed for i in r["individuals"]}


@pytest.mark.slow
def test_an_event(checkout: Path) -> None:
    """The event pays by the file's row."""
    (checkout / "tree.bt").write_text(LAPS, encoding="utf-8")
    with_rewards = (*PLAY, *NEAR, "--config-dir", "mine", "--set", "rewards=laps")
    lines = [*map(arguments_of, commands("sh checkout")), with_rewards, (*PLAY, *NEAR)]
    *outputs, laps, paper = in_a_process(checkout, *map(list, lines))
    assert "FAILED" not in "".join(outputs)
    assert list(checkout.glob("runs/smoke/*rewards=laps*/generations.jsonl"))
    for a, b in zip(json.loads(laps), json.loads(paper), strict=True):
        assert a["counters"]["laps"] > 0
        gained = a["components"]["patrol"] - b["components"]["patrol"]
        assert gained == 500 * a["counters"]["laps"]


def test_the_page_names_what_there_is() -> None:
    """Files, classes and tables that the page names exist, and the changes are not yet made."""
    named = re.findall(r"`((?:islandgp|tests|docs|conf)/[\w/.]+)`", TEXT)
    assert len(named) > 8
    assert [name for name in named if not (ROOT / name).exists()] == []
    assert "lap" not in SCHEMA.events
