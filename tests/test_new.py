"""`islandgp new`: each kind of folder runs at once, and names that cannot be used are refused."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

from islandgp.commands.new import new_command as command
from tests.running.commands import in_process

ROOT = Path(__file__).parents[1]
ENVIRONMENTS = ("Pendulum-v1", "FrozenLake-v1")
KINDS = [
    ("rover",),
    ("hauler", "--kind", "ros2"),
    *((f"world{i}", "--kind", "gymnasium", "--environment", e) for i, e in enumerate(ENVIRONMENTS)),
]
"""Arguments; the names differ, because a process keeps the domains that it has read."""
PLACEHOLDERS = ("my_robot", "MyRobot", "ENVIRONMENT", "MIDDLE", "GOOD", "OBSERVATIONS", "TARGET")


@pytest.mark.parametrize("arguments", KINDS, ids=" ".join)
def test_a_new_robot_runs_at_once(arguments: tuple[str, ...], tmp_path: Path) -> None:
    """Its tree passes `check` without a warning and plays; no file has a placeholder."""
    assert "make run" in in_process(tmp_path)("new", *arguments)
    islandgp = in_process(tmp_path / arguments[0])
    assert "no warnings" in islandgp("check", "by_hand.bt", "--config-dir", "conf")
    assert "fitness" in islandgp("play", "by_hand.bt", "--config-dir", "conf", "--seeds", "2")
    for file in (path for path in (tmp_path / arguments[0]).rglob("*.*") if path.is_file()):
        if file.suffix == ".pyc":
            continue
        text = file.read_text(encoding="utf-8")
        assert [word for word in PLACEHOLDERS if word in text] == [], file


def test_the_map_has_each_action_and_key(tmp_path: Path) -> None:
    """`robot.yaml` of a ROS 2 robot maps the whole vocabulary of its simulator."""
    in_process(tmp_path)("new", "truck", "--kind", "ros2")
    printed = in_process(tmp_path / "truck")("domain", "truck", "--config-dir", "conf", "--json")
    vocabulary = json.loads(printed)["vocabulary"]
    robot_map = yaml.safe_load((tmp_path / "truck" / "robot.yaml").read_text(encoding="utf-8"))
    assert set(robot_map["actions"]) == set(vocabulary["actions"])
    assert set(robot_map["keys"]) == set(vocabulary["keys"])


@pytest.mark.parametrize(
    ("arguments", "found"),
    [
        (["../x"], "found '../x'; use lower-case letters"),
        ([""], "found '.'"),
        (["class"], "found 'class'"),
        (["json"], "found json, the name of a module"),
        (["island"], "found island, the name of a module, a domain"),
        (["tests"], "found tests, the name of a module, a domain or a file here"),
        (["x9", "--environment", "CartPole-v1"], "expected --kind gymnasium with --environment"),
        (["x9", "--kind", "gymnasium", "--environment", "Nope-v1"], "found Environment"),
        (["x9", "--kind", "gymnasium", "--environment", "Blackjack-v1"], "found Tuple(Discrete"),
    ],
)
def test_other_names_are_refused(
    arguments: list[str], found: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One message names what was found, and no folder is left."""
    monkeypatch.chdir(ROOT)
    before = sorted(ROOT.iterdir())
    result = CliRunner().invoke(command, arguments)
    assert result.exit_code != 0
    assert found in (result.output + str(result.exception))
    assert sorted(ROOT.iterdir()) == before


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_a_folder_that_cannot_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    """One message, also where root may write everywhere else."""
    monkeypatch.chdir("/proc")
    result = CliRunner().invoke(command, ["rover"])
    assert "rover: expected a folder that can be written, found: " in str(result.exception)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["simulator", "gymnasium"])
def test_its_own_tests_pass(kind: str, tmp_path: Path) -> None:
    """`make test` in the folder, and a short evolution."""
    in_process(tmp_path)("new", "rover", "--kind", kind)
    place = tmp_path / "rover"
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}:{place}"}
    test = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    subprocess.run(test, cwd=place, env=environment, check=True)
    run = ["-m", "islandgp", "--config-dir", "conf", "domain=rover", "gp.generations=3"]
    subprocess.run([sys.executable, *run, "tracking=off"], cwd=place, env=environment, check=True)
