"""The documentation's site, and the files beside the package for other tools."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from importlib.util import find_spec

import pytest
import yaml

from tests.running.commands import ROOT

pytestmark = pytest.mark.process


@pytest.mark.slow
def test_the_site_is_built_without_warnings() -> None:
    """As `make docs` builds it; every page is there, can be found, and its replay has its data."""
    if find_spec("zensical") is None:
        pytest.skip("zensical is not installed: pip install 'islandgp[docs]'")
    builder = str(ROOT / ".venv" / "bin" / "zensical")
    for command in ([sys.executable, "docs/pages.py"], [builder, "build", "--clean", "--strict"]):
        process = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        assert process.returncode == 0, process.stdout + process.stderr
        assert "arning" not in process.stdout + process.stderr
    site = ROOT / "build" / "site"
    sources = [
        page.relative_to(ROOT / "build/pages") for page in (ROOT / "build/pages").rglob("*.md")
    ]
    pages = {  # a folder's README is its index
        page.with_name("index.html") if page.name == "README.md" else page.with_suffix(".html")
        for page in sources
    }
    assert {page for page in pages if not (site / page).exists()} == set()
    assert "gp.population" in (site / "configuration.html").read_text(encoding="utf-8")
    assert "parse" in (site / "api.html").read_text(encoding="utf-8")
    assert (site / "all_rounder.html").stat().st_size > 50_000
    index = json.loads(next(site.rglob("search*.json")).read_text(encoding="utf-8"))
    assert "supervisor" in json.dumps(index)


def test_compose_has_its_three_services() -> None:
    """The worker waits for the server, the server for the database; no password is written down."""
    text = (ROOT / "compose.yaml").read_text(encoding="utf-8")
    services = yaml.safe_load(text)["services"]
    assert set(services["worker"]["depends_on"]) == {"mlflow"}
    assert set(services["mlflow"]["depends_on"]) == {"database"}
    assert "POSTGRES_PASSWORD:?" in services["database"]["environment"]["POSTGRES_PASSWORD"]
    for name in services["mlflow"]["ports"]:
        assert name.startswith("127.0.0.1:")


def test_the_image_has_all_that_the_wheel_needs() -> None:
    """Each folder that pyproject.toml packs is copied, and let through by .dockerignore."""
    packed = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]
    wheel = packed["targets"]["wheel"]
    copied = (ROOT / "Dockerfile").read_text()
    allowed = (ROOT / ".dockerignore").read_text().splitlines()
    for folder in (*wheel["packages"], *wheel["force-include"]):
        assert f"COPY {folder} {folder}\n" in copied
        assert f"!{folder}" in allowed


def test_the_citation_is_of_this_version() -> None:
    """The keys that the Citation File Format 1.2.0 requires, and the package's own version."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert {"cff-version", "message", "title", "authors"} <= set(citation)
    assert (citation["cff-version"], citation["authors"]) == (
        "1.2.0",
        [{"name": "The islandgp authors"}],
    )
    assert (citation["version"], citation["license"]) == (project["version"], project["license"])


def test_the_workflow_runs_targets_that_exist() -> None:
    """On each supported Python, with no right to write."""
    workflow = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8"))
    jobs = workflow["jobs"]
    commands = {name: [s["run"] for s in job["steps"] if "run" in s] for name, job in jobs.items()}
    assert workflow["permissions"] == {"contents": "read"}
    assert jobs["test"]["strategy"]["matrix"]["python"] == ["3.11", "3.12", "3.13", "3.14"]
    assert (commands["test"][-1], commands["docs"]) == (".ci/run", ["make docs"])
    assert commands["coverage"] == ["make coverage"]
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert {"docs", "coverage", "test-slow"} <= set(targets)


def test_hooks_run_tools_of_the_environment() -> None:
    """No hook comes from another repository."""
    config = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))
    assert [source["repo"] for source in config["repos"]] == ["local"]
    assert all(hook["entry"].startswith(".venv/bin/") for hook in config["repos"][0]["hooks"])
