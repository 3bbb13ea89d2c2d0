"""Commands of the studies' pages and scripts run."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
from pathlib import Path

import pytest

from islandgp.running.app import main
from tests.running.commands import ROOT, fake
from tests.studies.configured import studied

STUDIES = ROOT / "studies"
SMALL = ("gp.population=7", "gp.generations=3", "world.episode.length=20", "progress=off")


def commands(page: Path) -> list[list[str]]:
    """The commands of a page's blocks ```sh, as words."""
    blocks = re.findall(r"^```sh\n(.*?)^```", page.read_text("utf-8"), re.MULTILINE | re.DOTALL)
    return [shlex.split(line) for block in blocks for line in block.splitlines()]


PAGES = [page for page in sorted(STUDIES.glob("*/README.md")) if commands(page)]


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.parent.name)
def test_the_commands_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of them, one after the other, on small runs in an empty folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "studies").symlink_to(STUDIES)
    extra = (*SMALL, *fake("Instant"))
    for words in commands(page):
        assert words[:3] == ["python", "-m", "islandgp"], words
        first = next(iter(sorted(tmp_path.glob("runs/*/*-seed1-*"))), None)
        if first is not None and any("yoked" in w or "another_record" in w for w in words):
            record = str(first).replace("seed1", "seed{seed}")  # its name has the small overrides
            words = [w for w in words if not w.startswith("supervisor.policy.record=")]
            words.append(f'supervisor.policy.record="{record}"')
        assert main([*words[3:], *extra]) == 0, words


def test_the_study_is_the_paper_s_experiment() -> None:
    """The sweep of `make study` has the paper's numbers."""
    settings = studied("experiment=study")
    assert (settings.gp.population, settings.gp.generations) == (30, 41)
    assert (settings.name, settings.search.name) == ("study", "paper")


@pytest.mark.parametrize("name", ["paper", "controls", "editors"])
def test_scripts_compose(name: str, tmp_path: Path) -> None:
    """Each run of a script composes; `--cfg` prints its configuration in place of running it."""
    bin_folder, log = tmp_path / "bin", tmp_path / "log"
    bin_folder.mkdir()
    for command in ("python", "islandgp"):
        file = bin_folder / command
        file.write_text(f'#!/bin/sh\nprintf "%s\\n" "$*" >> {log}\n')
        file.chmod(0o755)
    environment = {**os.environ, "PATH": f"{bin_folder}:{os.environ['PATH']}"}
    script = f"sha256sum() {{ :; }}; set -- {bin_folder}; . {STUDIES / name / 'run.sh'}"
    subprocess.run(["sh", "-c", script], cwd=tmp_path, env=environment, check=False)
    lines = log.read_text().splitlines()
    runs = [line for line in lines if line.startswith("-m islandgp")]
    assert any(line.startswith("compare --config-dir studies/conf") for line in lines)
    for line in runs:
        words = [w for w in line.split()[2:] if w != "-m" and "record=" not in w]
        overrides = [first_value(w) for w in words if "=" in w]
        assert studied(*overrides).name.startswith(("study", "ablation")), line


def first_value(override: str) -> str:
    """An override of a sweep, with its first value."""
    key, _, value = override.partition("=")
    span = re.fullmatch(r"range\((\d+),\d+\)", value)
    return f"{key}={span[1]}" if span else f"{key}={value.split(',')[0]}"
