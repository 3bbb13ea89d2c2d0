"""A stranger's distribution: commands and configuration by entry points (docs/extending.md)."""

from __future__ import annotations

import re
import tomllib
import zipfile
from importlib import import_module
from pathlib import Path

import pytest

from tests.architecture.sources import PACKAGE, ROOT
from tests.packaging.environments import call, fails, install, new_environment, run, wheel_of
from tests.trees.shell import Cli

pytestmark = pytest.mark.packaging

TEXT = (ROOT / "docs/extending.md").read_text(encoding="utf-8")
SECTION = TEXT.partition("## A package with commands and configuration\n")[2].partition("\n## ")[0]
SMALL = ("gp.generations=2", "gp.population=8", "progress=off", "evaluator=serial")

BROKEN = """
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "broken-plugin"
version = "2.0"

[project.entry-points."islandgp.commands"]
missing = "broken_plugin.nowhere:command"
stops = "broken_plugin.stops:command"
number = "broken_plugin:NUMBER"
check = "broken_plugin:NUMBER"
actions = "broken_plugin:NUMBER"

[project.entry-points."islandgp.conf"]
missing = "broken_plugin.nowhere"
hidden = "broken_plugin.conf"
"""

PLUGINS = sorted(file.parent for file in ROOT.glob("plugins/*/pyproject.toml"))
TREE = "selector { when batteryLevel < 40 { SeekCharger } PatrolWaypoint }"
COMMANDS = {
    "numbers": (("tune", "--help"), 0, "Tune the thresholds of the tree in FILE with CMA-ES"),
    "ray": (("run", "evaluator=ray", "--cfg", "job"), 0, "factory: islandgp_ray.evaluator:Ray"),
    "plans": (("run", "search=plans", "--cfg", "job"), 0, "factory: islandgp_plans.plans:Plans"),
    "editor": (("language-server", "--help"), 0, "Serve an editor over standard input and output"),
    "judge": (("judge", "--domain", "moon"), 2, "--domain: expected one of island, lunarlander"),
    "verify": (("verify-tree", "tree.bt", "never SeekCharger while lap > 3"), 1, ": refuted, in 1"),
    "ros2": (("ros2", "tree.bt", "--map", "tree.bt"), 2, "tree.bt: expected `actions:` and"),
}
"""Words that only an installed plug-in understands, their exit code, and what they print."""


def commands_of(folder: Path) -> dict[str, str]:
    """The entry points of a plug-in's commands, by name."""
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    commands: dict[str, str] = project["entry-points"].get("islandgp.commands", {})
    return commands


def write_page(folder: Path) -> None:
    """Writes the files of the page's section, each under the name in its first line."""
    blocks = re.findall(r"^```(?:toml|python|yaml)\n# (\S+)\n(.*?)^```", SECTION, re.M | re.S)
    assert len(blocks) == 4
    for name, text in blocks:
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")


def write_broken(folder: Path) -> None:
    """Writes a distribution whose commands and folders cannot be used."""
    package = folder / "broken_plugin"
    (package / "conf" / "domain").mkdir(parents=True)
    (folder / "pyproject.toml").write_text(BROKEN, encoding="utf-8")
    (package / "__init__.py").write_text("NUMBER = 3\n", encoding="utf-8")
    (package / "stops.py").write_text("raise SystemExit('no')\n", encoding="utf-8")
    (package / "conf" / "domain" / "island.yaml").write_text("domain: {}\n", encoding="utf-8")


@pytest.fixture(scope="module")
def python(core: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python of a fresh environment with the core's wheel and the page's."""
    folder = tmp_path_factory.mktemp("a stranger")
    write_page(folder)
    interpreter = new_environment(tmp_path_factory.mktemp("environment"))
    install(interpreter, core, wheel_of(folder))
    return interpreter


def test_the_page_s_command_and_domain(python: Path, tmp_path: Path) -> None:
    """The commands of the page: the domain is sound, evolves, and the command reads its tree."""
    lines = re.findall(r"^\$ islandgp (.*)$", SECTION, re.MULTILINE)
    assert len(lines) == 3
    command = python.with_name("islandgp")
    (tmp_path / "tree.bt").write_text("selector { when warmth < 20 { Heat } Wait }", "utf-8")
    outputs = []
    for line in lines:
        words = line.split()
        small = SMALL if words[0] == "run" else ()
        outputs.append(call(command, *words, *small, cwd=tmp_path))
    assert "FAILED" not in outputs[0]
    assert "Best robot" in outputs[1]
    assert outputs[2] == "Heat\nWait\n"
    shown = call(command, "--help", cwd=tmp_path)
    assert re.search(r"^  actions +print the actions of a tree; adds", shown, re.MULTILINE)
    (folder,) = tmp_path.glob("runs/smoke/*")
    assert folder.name in call(command, "best", folder, "--workers", "1", cwd=tmp_path)


def test_a_file_of_the_user_with_the_name_of_the_stranger_s(python: Path, tmp_path: Path) -> None:
    """One message names both files."""
    (tmp_path / "mine/domain").mkdir(parents=True)
    (tmp_path / "mine/domain/heater.yaml").write_text("name: mine\n", encoding="utf-8")
    error = fails(python, "-m", "islandgp", "--config-dir", "mine", "domain=heater", cwd=tmp_path)
    assert "expected files with names of their own, found" in error
    assert error.count("heater.yaml") == 2


@pytest.mark.parametrize("content", [b"rewards: [1", b"\xff"])
def test_a_broken_file_of_a_distribution(python: Path, tmp_path: Path, content: bytes) -> None:
    """One line names it; other domains work."""
    (file,) = python.parents[1].rglob("islandgp_heater/conf/domain/heater.yaml")
    before = file.read_bytes()
    file.write_bytes(content)
    try:
        error = fails(python, "-m", "islandgp", "domain=heater", "tracking=off", cwd=tmp_path)
        call(python, "-m", "islandgp", "domain=cartpole", "--cfg", "job", cwd=tmp_path)
    finally:
        file.write_bytes(before)
    assert error.startswith("islandgp: ")
    assert str(file) in error
    assert error.count("\n") == 1


@pytest.mark.slow  # an environment of its own
def test_a_broken_distribution_is_named_and_others_work(core: Path, tmp_path: Path) -> None:
    """One line for each command, exit code 2; folders are left out with a line."""
    folder, page = tmp_path / "broken", tmp_path / "page"
    write_broken(folder)
    write_page(page)
    interpreter = new_environment(tmp_path / "environment")
    install(interpreter, core, wheel_of(folder), wheel_of(page))
    command = interpreter.with_name("islandgp")
    tree = tmp_path / "tree.bt"
    tree.write_text("domain heater\nHeat\n", encoding="utf-8")
    assert "no warnings" in call(command, "check", tree, cwd=tmp_path)
    assert "missing" in call(command, "--help", cwd=tmp_path)
    for name, found in {
        "missing": "ModuleNotFoundError: No module named 'broken_plugin.nowhere'",
        "stops": "SystemExit: no",
        "number": "found a int",
        "actions": "found broken-plugin 2.0 and islandgp-heater 1.0",
    }.items():
        error = fails(command, name, "x.bt", "--words", "-h", cwd=tmp_path)
        assert error.startswith(f"islandgp: {name}: expected ")
        assert found in error
        assert error.count("\n") == 1
    words = ("domain=heater", "experiment=smoke", "tracking=off", *SMALL)
    printed = call(interpreter, "-m", "islandgp", *words, cwd=tmp_path, errors=True)
    assert "Best robot" in printed
    lines = re.findall(r"^islandgp: broken-plugin 2.0 is left out: (.*)$", printed, re.MULTILINE)
    assert len(lines) == 2
    assert "broken_plugin.nowhere of configuration, with names of its own, found none" in lines[1]
    assert "conf/domain/island.yaml hides" in lines[0]


@pytest.mark.slow
def test_each_plugin_from_its_wheel(python: Path, tmp_path: Path) -> None:
    """Only with its wheel is its command there; the wheel has its package and nothing else."""
    (tmp_path / "tree.bt").write_text(TREE, encoding="utf-8")
    command = python.with_name("islandgp")
    for folder in PLUGINS:
        words, code, text = COMMANDS[folder.name]
        missing = run(command, *words, cwd=tmp_path)
        assert re.match(r"islandgp: (expected a command|\w+=\w+: unknown option)", missing.stderr)
        wheel = wheel_of(folder, tmp_path / folder.name)
        tops = {name.partition("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
        assert {t for t in tops if not t.endswith(".dist-info")} == {f"islandgp_{folder.name}"}
        install(python, wheel)
        found = run(command, *words, cwd=tmp_path)
        assert found.returncode == code, found.stderr
        assert text in found.stdout + found.stderr


@pytest.mark.parametrize("folder", PLUGINS, ids=lambda folder: folder.name)
def test_the_help_of_a_plugin_ends_with_an_example(folder: Path, islandgp: Cli) -> None:
    """As that of the core's commands; its options exist."""
    for name, value in commands_of(folder).items():
        module, _, attribute = value.partition(":")
        command = getattr(import_module(module), attribute)
        result = islandgp(name, "--help")
        (example,) = re.findall(r"^Example:\n  islandgp (.*)$", command.epilog, re.MULTILINE)
        assert result.out.rstrip().endswith(f"islandgp {example}")
        assert example.split()[0] == name


def test_no_module_of_the_package_names_a_plug_in() -> None:
    """No module of `islandgp` names a package of plugins/, or one of their commands."""
    names = {path.name for path in (ROOT / "plugins").glob("*/islandgp_*")}
    for folder in PLUGINS:
        names |= {f"islandgp {name}" for name in commands_of(folder)}
    assert len(names) > len(PLUGINS) > 0
    sources = [path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")]
    assert [name for name in names if any(name in source for source in sources)] == []
