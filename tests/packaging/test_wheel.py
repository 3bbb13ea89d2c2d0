"""The wheel: installed alone, it runs from any folder."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.domains.test_tutorial import EXAMPLE, follow
from tests.llm.server import MessagesServer
from tests.packaging.environments import call, install, new_environment
from tests.running.commands import Command

ROOT = Path(__file__).parents[2]
FOLDERS = ("conf", "grammar", "prompts")

pytestmark = pytest.mark.packaging


@pytest.fixture(scope="module")
def python(core: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python of a new environment that has the wheel, and the dependencies of this one."""
    interpreter = new_environment(tmp_path_factory.mktemp("environment"))
    install(interpreter, core)
    return interpreter


def test_everything_travels(core: Path) -> None:
    """Each file of conf, grammar and prompts is in the wheel, and the licence."""
    names = set(zipfile.ZipFile(core).namelist())
    files = {
        f"islandgp/{path.relative_to(ROOT).as_posix()}"
        for folder in FOLDERS
        for path in (ROOT / folder).rglob("*")
        if path.is_file()
    }
    assert len(files) > 20
    assert files - names == set()
    assert any(name.endswith("licenses/LICENSE") for name in names)


def test_the_wheel_has_no_tests_and_documentation(core: Path) -> None:
    """Tests, documentation and caches stay at home."""
    names = zipfile.ZipFile(core).namelist()
    tops = {name.partition("/")[0] for name in names}
    assert {t for t in tops if not t.endswith(".dist-info")} == {"islandgp"}
    assert [name for name in names if "__pycache__" in name or "/tests/" in name] == []


def test_a_run_from_another_folder(python: Path, tmp_path: Path) -> None:
    """`python -m islandgp` runs in an empty folder, from the wheel's own configuration."""
    small = ("gp.population=8", "gp.generations=2", "evaluator=serial")
    overrides = ("experiment=smoke", "domain=cartpole", "tracking=off", "progress=off", *small)
    output = call(python, "-m", "islandgp", *overrides, cwd=tmp_path)
    assert "Best robot" in output
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]
    code = "import islandgp.resources as r; print(r.resource('prompts'), r.resource('grammar'))"
    places = call(python, "-c", code, cwd=tmp_path)
    assert str(ROOT) not in places
    assert str(python.parents[1]) in places


def test_the_command(python: Path, tmp_path: Path) -> None:
    """The `islandgp` command is there, and prints its version."""
    assert "0.3.0" in call(python.with_name("islandgp"), "--version", cwd=tmp_path)


@pytest.mark.slow
def test_same_records_as_the_checkout(python: Path, tmp_path: Path) -> None:
    """The installed program writes the same records as the checkout."""
    overrides = ("experiment=smoke", "tracking=off", "progress=off", "gp.generations=3")
    call(python, "-m", "islandgp", *overrides, "runs=installed", cwd=tmp_path)
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "islandgp", *overrides, "runs=checkout"]
    subprocess.run(command, cwd=tmp_path, env=env, check=True, capture_output=True)
    one, two = (tmp_path / name for name in ("installed", "checkout"))
    (first,), (second,) = (list(p.rglob("generations.jsonl")) for p in (one, two))
    assert first.read_bytes() == second.read_bytes()


@pytest.mark.slow
def test_a_user_s_domain(python: Path, tmp_path: Path) -> None:
    """docs/own_domain.md, each command of it, with the wheel alone."""
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}

    def place(folder: Path) -> Command:
        return lambda *arguments: call(
            python.with_name("islandgp"), *arguments, cwd=folder, env=env
        )

    assert "First Placed One Robot" in follow(tmp_path, place)


@pytest.mark.slow
def test_rewards_of_a_user_work_with_the_wheel(python: Path, tmp_path: Path) -> None:
    """Another reward table is a file in a user's folder."""
    folder = tmp_path / "mine" / "rewards"
    folder.mkdir(parents=True)
    text = "defaults: [paper, _self_]\nevents:\n  patrol: {component: patrol, base: 500}\n"
    (folder / "patrol.yaml").write_text(text, encoding="utf-8")
    overrides = ("--config-dir", "mine", "rewards=patrol", "experiment=smoke", "tracking=off")
    output = call(python, "-m", "islandgp", *overrides, "progress=off", cwd=tmp_path)
    assert "Best robot" in output


@pytest.mark.slow
def test_everything_on_a_domain_from_outside(python: Path, tmp_path: Path) -> None:
    """Each supervisor and each command, in an empty folder, with --config-dir and PYTHONPATH."""
    empty, robot = tmp_path / "an empty folder", tmp_path / "robot"
    empty.mkdir()
    shutil.copytree(EXAMPLE, robot)
    env = {**os.environ, "PYTHONPATH": str(robot), "COLUMNS": "40"}
    env.pop("ANTHROPIC_API_KEY", None)
    options = ("--config-dir", robot / "conf")

    def islandgp(*arguments: str | Path) -> str:
        return call(python.with_name("islandgp"), *arguments, cwd=empty, env=env)

    def run(*overrides: str) -> str:
        small = ("domain=pick_place", "experiment=smoke", "tracking=off", "progress=off")
        return islandgp("run", *options, *small, "evaluator=serial", *overrides)

    for supervisor in ("baseline", "editor", "expert"):
        assert "Best robot" in run(f"supervisor={supervisor}")
    with MessagesServer() as server:
        assert "Best robot" in run("supervisor=llm", f"supervisor.policy.base_url={server.url}")
        assert server.requests
    (recorded,) = (empty / "runs" / "smoke").glob("llm-*")
    assert "Best robot" in run("supervisor=replay", f"supervisor.policy.transcript='{recorded}'")
    tree = robot / "carry.bt"
    assert "no warnings" in islandgp("check", tree, *options)
    assert "finished" in islandgp("play", tree, *options, "--seeds", "3")
    islandgp("replay", tree, *options, "-o", "a replay.html")
    islandgp("replay", recorded / "best.bt", *options, "-o", "best.html")
    islandgp("export", tree, *options, "-o", "carry.xml")
    assert "MoveToPick" in (empty / "carry.xml").read_text(encoding="utf-8")
    arms = ("--arm", "expert=supervisor=expert", "--arm", "baseline=supervisor=baseline")
    output = islandgp("compare", *options, *arms, "runs/smoke", "--worlds", "2")
    assert "study/expert-baseline/index.html" in output
    page = empty / "study" / "expert-baseline" / "index.html"
    assert "expert against baseline" in page.read_text(encoding="utf-8")
