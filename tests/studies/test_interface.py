"""The studies use the public interface, and the package does not know them."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

import islandgp
from islandgp.cli import islandgp as cli
from islandgp.running.app import main
from tests.running.commands import ROOT, fake
from tests.studies.configured import CONF

STUDIES = ROOT / "studies"
SECTION = (ROOT / "docs/extending.md").read_text("utf-8").split("## Public modules")[1]
PUBLIC = set(re.findall(r"`(islandgp[\w.]*)`", SECTION.split("\n## ")[0]))
TINY = ("experiment=smoke", "gp.population=6", "gp.generations=4", "world.episode.length=20")
QUIET = ("search=paper", "tracking=off", "progress=off", *fake("Instant"))


def package_names(source: str) -> Iterator[tuple[str, str]]:
    """Each name of the package that a module uses, with the module that has it."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("islandgp"):
            yield from ((str(node.module), alias.name) for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from ((a.name, "__all__") for a in node.names if a.name.startswith("islandgp"))
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == "islandgp":
            yield "islandgp", node.attr


def test_imports_are_public() -> None:
    """Modules of the table in docs/extending.md, and names of `islandgp.__all__`."""
    used = {
        name for file in STUDIES.rglob("*.py") for name in package_names(file.read_text("utf-8"))
    }
    assert len(used) > 20
    modules = {module for module, _ in used if not module.startswith("islandgp_")}  # plug-ins
    assert modules - PUBLIC == set()
    assert {name for _, name in used if name.startswith("_")} <= {"__all__"}
    top = {name for module, name in used if module == "islandgp"} - {"__all__"}
    assert top - set(islandgp.__all__) == set()


def test_public_modules_exist() -> None:
    """Each module of the table can be imported."""
    for name in PUBLIC:
        path = ROOT.joinpath(*name.split("."))
        assert path.with_suffix(".py").exists() or (path / "__init__.py").exists(), name


def test_the_package_does_not_know_the_studies() -> None:
    """Neither its code nor its configuration names their modules."""
    files = [*(ROOT / "islandgp").rglob("*.py"), *(ROOT / "conf").rglob("*.yaml")]
    assert [f for f in files if re.search(r"\bstudies\.", f.read_text("utf-8"))] == []


def test_classes_of_the_configuration_are_theirs() -> None:
    """Each supervisor of `studies/conf` is a class of the studies."""
    for file in (CONF / "supervisor").glob("*.yaml"):
        assert yaml.safe_load(file.read_text("utf-8"))["factory"].startswith("studies."), file


def test_a_control_runs_and_is_compared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A sweep over an arm of the package and one of the studies; the report has both."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda *_, **__: None)
    options = ("--config-dir", str(CONF))
    assert main([*options, "supervisor=expert,untargeted", "seed=0,1", *TINY, *QUIET, "-m"]) == 0
    runs = islandgp.load("runs").runs
    assert sorted(runs["supervisor"]) == ["expert", "expert", "untargeted", "untargeted"]
    sources = islandgp.load("runs").generations.groupby("source").size()
    assert sources.to_dict() == {"expert": 6, "untargeted": 6}
    few = ("--worlds", "0", "-o", "report")
    result = CliRunner().invoke(cli, ["compare", *options, *few])
    assert result.exit_code == 0, result.output
    assert "untargeted" in Path("report/index.html").read_text("utf-8")
