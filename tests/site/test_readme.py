"""The README, and the paper's page: commands exist and compose; the first run is as shown."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

from islandgp.cli import islandgp
from islandgp.running.app import main
from tests.running.commands import ROOT

TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
PAPER = (ROOT / "docs/paper.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```console\n(.*?)^```", TEXT + PAPER, re.MULTILINE | re.DOTALL)
COMMANDS = [
    shlex.split(line.removeprefix("$ "), comments=True)
    for block in BLOCKS
    for line in block.splitlines()
]
TREE = "".join(re.findall(r"^```\n(selector .*?^)```", TEXT, re.MULTILINE | re.DOTALL))


@pytest.mark.parametrize(
    "words", [w for w in COMMANDS if w[0] == "islandgp"], ids=lambda words: " ".join(words)[:40]
)
def test_a_command_has_its_options(words: list[str]) -> None:
    """As its help shows them."""
    shown = CliRunner().invoke(islandgp, [words[1], "--help"])
    assert shown.exit_code == 0, shown.output
    for option in (word for word in words if word.startswith("-")):
        assert re.search(rf"{option}\b", shown.output), option


@pytest.mark.parametrize(
    "words", [w for w in COMMANDS if w[0] == "python"], ids=lambda words: " ".join(words)[:60]
)
def test_an_experiment_composes(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Its configuration can be printed; with all runs of a sweep left out."""
    overrides = [word.partition(",")[0] for word in words[3:] if word != "-m"]
    overrides = [word for word in overrides if not word.startswith("seed=range")]
    assert main([*overrides, "--cfg", "job"]) == 0
    assert "supervisor:" in capsys.readouterr().out


def test_it_is_short() -> None:
    """At most 900 words with its commands and tables."""
    assert len(TEXT.split()) <= 900


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_first_run_is_as_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`make run` evolves the tree of the README and prints its figures, `play` others."""
    monkeypatch.chdir(tmp_path)
    assert main(["tracking=off", "progress=off"]) == 0
    printed = capsys.readouterr().out
    for figure in re.findall(r"([\d,]+ \[[\d,]+, [\d,]+\]) (?:points )?more than", TEXT)[:1]:
        mean, low, high = re.findall(r"[\d,]*\d", figure)
        assert f"+{mean} points (95 %: +{low} to +{high})" in printed
    best = Path("runs/default/expert-seed0/best.bt")
    assert best.read_text(encoding="utf-8").endswith(TREE)
    invoke = CliRunner().invoke
    Path("all_rounder.bt").write_text(invoke(islandgp, ["examples", "all_rounder"]).output)
    (words,) = (words for words in COMMANDS if words[:2] == ["islandgp", "play"])
    table = invoke(islandgp, words[1:]).output
    difference = re.search(r"in 100 others ([\d,]+) \[([\d,]+), ([\d,]+)\]", TEXT)
    assert difference is not None
    earned, low, high = difference.groups()
    assert f"+{earned} (+{low} to +{high})" in table, table
