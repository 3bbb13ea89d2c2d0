"""`islandgp run` is `python -m islandgp`: the user's parts are in the current folder."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from islandgp.cli import islandgp
from islandgp.errors import ConfigError
from tests.running.commands import ROOT

pytestmark = pytest.mark.process

EXAMPLES = ROOT / "grammar/examples"

SUPERVISOR = """
from islandgp.supervision.baseline import Baseline

class Mine(Baseline):
    pass
"""

EVALUATOR = """
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from islandgp.evaluation.base import simulate
from islandgp.evaluation.serial import Serial

class Mine(Serial):
    def evaluate(self, jobs):
        with ProcessPoolExecutor(1, get_context("forkserver")) as pool:
            return list(pool.map(work, [self.problem] * len(jobs), jobs))

def work(setting, job):
    return simulate(setting, job)
"""

OVERRIDES = (
    "supervisor=baseline",
    "supervisor.factory=mysup:Mine",
    "evaluator=serial",
    "evaluator.factory=myeval:Mine",
    "experiment=smoke",
    "gp.population=4",
    "gp.generations=2",
    "gp.validation=0",
    "domain=cartpole",
    "world.ticks=5",
    "tracking=off",
    "progress=off",
)


def script(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Runs `islandgp ARGUMENTS` in `folder`, by a script elsewhere as an installer writes it."""
    file = folder / "bin" / "islandgp"
    file.parent.mkdir()
    file.write_text(
        "import sys\nfrom islandgp.cli import main\n"
        "if __name__ == '__main__':\n    sys.exit(main())\n"
    )
    (folder / "mysup.py").write_text(SUPERVISOR)
    (folder / "myeval.py").write_text(EVALUATOR)
    return subprocess.run(
        [sys.executable, str(file), *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )


def test_a_run_finds_parts_in_the_current_folder(tmp_path: Path) -> None:
    """Also in the processes that it starts."""
    process = script(tmp_path, "run", *OVERRIDES)
    assert process.returncode == 0, process.stderr
    assert "Best robot" in process.stdout


@pytest.mark.slow
def test_jobs_of_a_launcher_find_parts_in_the_current_folder(tmp_path: Path) -> None:
    """In its workers, and in the processes that those start."""
    launcher = ("hydra/launcher=local", "hydra.launcher.n_jobs=2", "seed=0,1", "-m")
    process = script(tmp_path, "run", *OVERRIDES, *launcher)
    assert process.returncode == 0, process.stderr
    assert len(list(tmp_path.rglob("summary.json"))) == 2


@pytest.mark.slow
def test_commands_with_settings_find_parts_in_the_current_folder(tmp_path: Path) -> None:
    """`--set` takes what a run takes."""
    tree = ROOT / "grammar/examples/poor.bt"
    overrides = ("world.episode.length=5", *OVERRIDES[2:4])
    process = script(
        tmp_path, "play", str(tree), "--seeds", "1", *(w for o in overrides for w in ("--set", o))
    )
    assert process.returncode == 0, process.stderr


def test_the_examples_are_listed_and_printed() -> None:
    """As they come with the package; each that is printed is a tree."""
    listed = CliRunner().invoke(islandgp, ["examples"])
    assert listed.exit_code == 0
    for file in EXAMPLES.glob("*.bt"):
        assert re.search(rf"^{file.stem} +\w", listed.stdout, re.MULTILINE)
        example = CliRunner().invoke(islandgp, ["examples", file.stem])
        assert example.stdout == file.read_text(encoding="utf-8")


def test_a_missing_example_is_reported() -> None:
    """With the names of those that are."""
    with pytest.raises(ConfigError, match=r"found all_round; there are all_rounder, charging"):
        CliRunner().invoke(islandgp, ["examples", "all_round"], catch_exceptions=False)
