"""`islandgp best`: the best robots of finished runs in test worlds."""

from __future__ import annotations

import json
from pathlib import Path
from shutil import copytree
from typing import Final

import pytest
from click.testing import CliRunner, Result

import islandgp
from islandgp.bt.core.language import parse
from islandgp.cli import islandgp as group
from islandgp.records.folder import RunFolder
from islandgp.seeding import Stream, stream
from tests.records.listed import add_to_manifest

SHORT = (
    "experiment=smoke",
    "gp.population=12",
    "gp.generations=4",
    "gp.validation=1",
    "world.episode.length=40",
    "tracking=off",
    "progress=off",
    "evaluator=serial",
)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run's folder, below one with a space in its name."""
    runs = tmp_path_factory.mktemp("best") / "my runs"
    experiment = islandgp.compose(*SHORT, f"runs={runs}")
    experiment.run()
    return experiment.folder


def best(run: Path, *options: str) -> Result:
    """The result of the command."""
    return CliRunner().invoke(group, ["best", str(run), "--workers", "1", *options])


def test_the_best_trees_are_tested_in_unused_worlds(run: Path, tmp_path: Path) -> None:
    """The best robot comes first, and no test world trained or chose it."""
    file = tmp_path / "best tree.bt"
    result = best(run, "--worlds", "3", "--json", "-o", str(file))
    assert result.exit_code == 0, result.output
    rows = json.loads(result.stdout)
    assert [row["name"] for row in rows if row["evolved"]] == [run.name]
    assert rows[0]["difference"] == 0
    assert rows[-1]["name"] == "library: multi_behaviour"
    assert not rows[-1]["evolved"]
    assert parse(file.read_text(encoding="utf-8")) == parse(rows[0]["tree"])
    folder = RunFolder(run)
    known_worlds = {world for record in folder.records() for world in record["worlds"]}
    known_worlds |= set(folder.summary()["champion"]["validation"]["worlds"])
    seed = folder.configuration()["seed"]
    assert not known_worlds & {
        int(stream(seed, Stream.TEST, slot=k).integers(2**32)) for k in range(3)
    }


@pytest.mark.slow
def test_a_repeated_command_has_the_same_result(run: Path) -> None:
    """The table is a function of the run."""
    assert best(run, "--worlds", "2").output == best(run, "--worlds", "2").output


FRONT: Final = [
    {
        "nodes": nodes,
        "tree": f"# {nodes}\nPatrolWaypoint\n",
        "difference": difference,
        "chosen": nodes == 5,
    }
    for nodes, difference in (
        (3, {"name": "the longest tree", "mean": -900.0, "low": -1200.0, "high": -600.0}),
        (5, {"name": "the longest tree", "mean": 12.0, "low": None, "high": None}),
        (9, None),
    )
]


def test_the_front_of_a_run(run: Path, tmp_path: Path) -> None:
    """Sizes with the differences to the longest tree; -o writes the best robot."""
    copied = tmp_path / "copy"
    copytree(run, copied)
    assert "its tree was not shortened" in str(best(copied, "--front").exception)
    summary = RunFolder(copied).summary()
    summary["champion"]["front"] = FRONT
    (copied / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    add_to_manifest(copied, "summary.json")
    assert json.loads(best(copied, "--front", "--json").output) == FRONT
    lines = best(copied, "--front").output.splitlines()
    assert [line.split() for line in lines[1:4]] == [
        ["3", "-900", "[-1,200,", "-600]"],
        ["5", "+12", "best", "robot"],
        ["9"],
    ]
    file = tmp_path / "short.bt"
    best(copied, "--front", "-o", str(file))
    assert file.read_text(encoding="utf-8") == FRONT[1]["tree"]


def test_a_single_test_world_is_refused(run: Path) -> None:
    """One world has no interval."""
    result = best(run, "--worlds", "1")
    assert result.exit_code != 0
    assert "1 is not in the range 2<=x<=10000" in result.output


@pytest.mark.slow
def test_the_best_robots_of_a_sweep(tmp_path: Path) -> None:
    """One of each run, the one with the highest mean in validation first; others are named."""
    runs = tmp_path / "a sweep"
    for seed in (3, 4):
        islandgp.compose(*SHORT, f"runs={runs}", f"seed={seed}").run()
    (folder,) = runs.iterdir()
    result = best(folder, "--worlds", "4", "--json")
    assert result.exit_code == 0, result.output
    rows = json.loads(result.stdout)
    means = islandgp.load(folder).runs.set_index("run")["validation_mean"]
    ranked = [*means.sort_values(ascending=False).index]
    assert [row["name"] for row in rows if row["evolved"]] == ranked
    assert rows[0]["difference"] == 0
    stopped = folder / ranked[0]
    for name in ("summary.json", "manifest.json"):
        (stopped / name).unlink()
    assert "left out, as they are not finished: " in best(folder, "--worlds", "2").output


def test_a_folder_without_a_finished_run(tmp_path: Path) -> None:
    """The message names what it needs."""
    assert "Expected a finished run" in str(best(tmp_path).exception)
