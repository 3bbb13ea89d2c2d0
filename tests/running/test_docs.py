"""docs/running.md and the pages that it lists: commands run, and names exist."""

from __future__ import annotations

import re
import shlex
from importlib.util import find_spec
from pathlib import Path
from typing import Any, cast

import pytest
from click.testing import CliRunner

import islandgp as library
from islandgp.cli import islandgp
from islandgp.gp.record import record_values
from islandgp.records.folder import RunFolder
from islandgp.records.parameters import RUNTIME_KEYS
from islandgp.results import COLUMNS
from islandgp.running.app import main
from islandgp.running.report import Progress, report
from islandgp.tracking.upload import FILES
from tests.running.commands import ROOT, finish, start
from tests.samples import CLASSES
from tests.tracking.folders import steps
from tests.tracking.test_metrics import COST, metrics

PAGES = ("docs/running", "docs/sweeps", "docs/results", "docs/mlflow", "plugins/ray/README")
TEXT = "\n".join((ROOT / f"{page}.md").read_text(encoding="utf-8") for page in PAGES)
TINY = [
    "experiment=smoke",
    "name=default",
    "gp.population=6",
    "gp.generations=3",
    "world.episode.length=20",
]
MODULES = {"ray": "ray", "submitit": "submitit", "": "loky"}


def commands(kind: str) -> list[list[str]]:
    """The commands of the blocks ```sh KIND, as words."""
    pattern = rf"^```sh{' ' + kind if kind else ''}\n(.*?)^```"
    blocks = re.findall(pattern, TEXT, re.MULTILINE | re.DOTALL)
    return [shlex.split(line) for block in blocks for line in block.splitlines()]


def small(command: list[str]) -> list[str]:
    """A command's overrides with a run of seconds in place of the default one."""
    return [*(word for word in command if not word.startswith("gp.")), *TINY, "progress=off"]


@pytest.mark.slow
def test_the_commands_run_unchanged(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One after the other in one folder, on a small run; those of launchers are tested below."""
    monkeypatch.chdir(home)
    Path("tree.bt").write_text("selector { PatrolWaypoint SeekCharger }")
    page_commands = commands("")
    assert len(page_commands) >= 8
    for command in page_commands:
        if command[0] == "islandgp":
            result = CliRunner().invoke(islandgp, command[1:])
            assert result.exit_code == 0, (command, result.output)
        elif not any(word.startswith("hydra/launcher") for word in command):
            assert main(small(command[3:])) == 0, command


def test_the_python_runs_unchanged(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its blocks one after the other, as one script, in a folder with a run."""
    monkeypatch.chdir(home)
    blocks = re.findall(r"^```python\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
    assert len(blocks) == 3
    assert main([*TINY, "progress=off", "tracking=off", "evaluator=serial"]) == 0
    names: dict[str, object] = {"__name__": "__main__"}
    exec(compile("\n".join(blocks), "running.md", "exec"), names)
    results = names["results"]
    assert isinstance(results, library.Results)
    assert list(results.runs["seed"]) == [1]
    assert len(names["outcomes"]) == 10  # type: ignore[arg-type] # a list


def test_the_groups_of_columns_are_named() -> None:
    """The frames have the columns that the page describes."""
    part = TEXT.partition("# Results in Python")[2].partition("# MLflow")[0]
    for kind, name in (("runs", n) for n in ("validation_mean", "champion_fitness", "fitness_max")):
        assert f"`{name}`" in part
        assert name in COLUMNS[kind]
    for group in ("first", "tiers", "specialists", "behaviour_counts", "components", "counters"):
        assert f"`{group}.`" in part


class Finished:
    """A finished run's folder with the numbers of the page's example."""

    path = Path("/home/me/runs/default/expert-seed0")
    agent = "Robot"

    def summary(self) -> dict[str, Any]:
        """As in summary.json."""
        validation = {
            "worlds": list(range(50)),
            "mean": 51952,
            "low": 49746,
            "high": 54158,
            "reached": dict.fromkeys(
                ("excellent", "complete", "full_service", "balanced_elite"), 1.0
            ),
            "comparisons": [
                {"name": "tree all_rounder", "mean": 2950, "low": 1327, "high": 4573},
                {"name": "best tree of generation 0", "mean": 2784, "low": 1514, "high": 4053},
            ],
        }
        components = {
            "garbage": 30600,
            "battery": 360,
            "humanoid": 25110,
            "delivery": 15880,
            "leftover": -3680,
            "patrol": 694,
            "idle": 0,
            "collision": -1500,
        }
        record = {"id": "12.24", "fitness": 67464, "components": components, "nodes": 30}
        return {
            "champion": {
                "record": record,
                "text": "the tree",
                "validation": validation,
                "front": [{"nodes": 14, "chosen": True}],
            },
            "fittest": {"record": {"fitness": 68396}, "generation": 39},
            "first": {"complete": 0, "excellent": 0},
            "answers": {},
            "nothing_works": "",
            "learned": [],
        }


def test_the_report_of_a_run_is_the_page_s() -> None:
    """The example is what the program prints for its numbers."""
    text = report(cast("RunFolder", Finished()), [])
    assert f"```text\n{text.partition(chr(10) * 2)[0]}\n```" in TEXT


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["", "ray", "submitit"])
def test_the_commands_of_launchers_run(kind: str, tmp_path: Path) -> None:
    """In a separate process, as a user gives them."""
    if find_spec(MODULES[kind]) is None:
        pytest.skip(f"{MODULES[kind]} is not installed")
    page_commands = [
        command for command in commands(kind) if kind or "hydra/launcher=local" in command
    ]
    assert page_commands
    for command in page_commands:
        code, output = finish(start(tmp_path, *small(command[3:]), "tracking=off"), 300)
        assert code == 0, output


def test_the_files_of_a_run_are_all_named() -> None:
    """The table of the folder names each file that a run leaves."""
    for name in {*FILES, "config.yaml", "about.json", "checkpoint.json"}:
        assert f"`{name}`" in TEXT, name


def test_every_section_of_charts_is_named() -> None:
    """The table of metrics has each section, and names metrics that exist."""
    records = [record_values(step.record) for step in steps()]
    names = metrics(records[0], COST)
    table = TEXT.partition("| section of charts |")[2].partition("\n\n")[0]
    rows = re.findall(r"^\| (`.*?`) \| (.*) \|$", table, re.MULTILINE)
    named = {name for cell, _ in rows for name in re.findall(r"`(\w+)`", cell)}
    assert {name.partition("/")[0] for name in names if "/" in name} <= named
    for cell, text in rows:
        (section, *others) = re.findall(r"`(\w+)`", cell)
        known = {f"run/{column}" for column in COLUMNS["runs"]} if section == "run" else names
        for metric in re.findall(r"`(\w+)`", text) if not others else []:
            assert f"{section}/{metric}" in known or metric == "first"


def test_what_may_differ_at_a_resumption_is_named() -> None:
    """The keys of RUNTIME_KEYS, and no others."""
    sentence = re.search(r"^(.*) may always differ", TEXT, re.MULTILINE)
    assert sentence is not None
    assert set(re.findall(r"`(\w+)`", sentence[1])) == RUNTIME_KEYS


def test_the_head_of_the_table_is_the_programs(capsys: pytest.CaptureFixture[str]) -> None:
    """The example of plain lines has the columns of today."""
    Progress("plain", lambda *_: 4, "a title", CLASSES.milestones, rate=False)
    assert capsys.readouterr().err.splitlines()[1] in TEXT


def test_each_picture_of_the_page_exists() -> None:
    """Each picture that the text shows is a file."""
    for name in re.findall(r"!\[[^]]*\]\(([^)]*)\)", TEXT):
        assert (ROOT / "docs" / name).is_file(), name
