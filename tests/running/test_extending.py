"""docs/extending.md: its files are written, its changes made, its commands run, as they stand."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.running.commands import ROOT, finish, start

TEXT = (ROOT / "docs/extending.md").read_text(encoding="utf-8")
COPIED = ("islandgp", "conf", "grammar", "prompts", "pyproject.toml")
SMALL = ("gp.generations=3", "gp.population=6", "world.episode.length=20", "progress=off")
NEAR = ("--set", "world.waypoints=[[150,160],[150,140]]")
LAPS = "selector { when batteryLevel < 40 { ReturnToStart } PatrolWaypoint }"


def blocks(kind: str) -> list[str]:
    """The blocks ```KIND of the page."""
    return re.findall(rf"^```{kind}\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


def test_worlds_and_supervisors_from_outside(tmp_path: Path) -> None:
    """The page's files in an empty folder, and its commands on a small run."""
    for text in [*blocks("yaml"), *blocks("python")]:
        path = tmp_path / text.splitlines()[0].removeprefix("# ")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    lines = [shlex.split(line) for block in blocks("sh") for line in block.splitlines()]
    assert len(lines) == 2
    for words in lines:
        code, said = finish(start(tmp_path, *words[3:], *SMALL))
        assert code == 0, said
    rates = [
        json.loads(line)["guidance"]["wanted_rate"]
        for path in tmp_path.glob("runs/smoke/cooling-*/generations.jsonl")
        for line in path.read_text().splitlines()[:-1]
    ]
    assert rates == [0.5, pytest.approx(0.3)]
    assert list(tmp_path.glob("runs/smoke/*world=pond*/summary.json"))


def test_actions_and_rewards_in_a_checkout(tmp_path: Path) -> None:
    """The page's changes in a copy of the checkout: the action drives, the reward pays."""
    if shutil.which("git") is None:
        pytest.skip("git is not installed, and applies the changes")
    for name in COPIED:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, tmp_path / name)
    changes = blocks("diff")
    assert len(changes) == 2
    for change in changes:
        subprocess.run(["git", "apply", "-"], cwd=tmp_path, input=change, text=True, check=True)
    (tmp_path / "laps.bt").write_text(LAPS)
    program = "from islandgp.cli import main; main()"
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}

    def run(*words: str) -> str:
        done = subprocess.run(
            [sys.executable, *words], cwd=tmp_path, env=environment, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    said = {
        points: run("-c", program, "play", "laps.bt", "--set", f"rewards.lap={points}", *NEAR)
        for points in (0, 500)
    }
    assert said[0] != said[500]
    run("-m", "islandgp", "experiment=smoke", "tracking=off", "evaluator=serial", *SMALL)
    (record,) = tmp_path.glob("runs/smoke/*/generations.jsonl")
    assert "ReturnToStart" in record.read_text()
