"""docs/llm.md and docs/llm: commands run, and names exist."""

from __future__ import annotations

import re
import shlex
import tempfile
from pathlib import Path

import pytest
from click.testing import CliRunner

from islandgp.commands.runs import estimate_command as command
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.resources import resource
from islandgp.supervision.llm.answers import RejectionStage
from islandgp.supervision.llm.history import EDIT_VALUES, RUN_VALUES
from islandgp.supervision.llm.prompts import PROMPT_SETS
from islandgp.supervision.llm.questions import Questions
from tests.composed import composed
from tests.llm.demo import demo
from tests.llm.samples import advise, answering, context, settings, supervisor
from tests.profiles import sweep

DOCS = resource("conf").parent / "docs"
PAGES = [
    DOCS / "llm.md",
    *sorted((DOCS / "llm").glob("*.md")),
]
TEXT = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
OUTSIDE = re.sub(r"^```.*?^```$", "", TEXT, flags=re.DOTALL | re.MULTILINE)
COMMANDS = re.findall(r"^    (\S.*)$", OUTSIDE, re.MULTILINE) + re.findall(
    r"^\| `(python .*?)` \|", OUTSIDE, re.MULTILINE
)


def overrides(line: str) -> list[str]:
    """The overrides of one job of a command, the first one of a sweep."""
    arguments = shlex.split(line)[3:]
    return [argument.replace("range(5)", "0") for argument in arguments if argument != "-m"]


@sweep("line", [c for c in COMMANDS if c.startswith("python -m islandgp ")], quick=4)
def test_every_run_of_the_document_composes(line: str) -> None:
    """Each command names options and keys that exist."""
    assert composed(*overrides(line)).supervisor.name in line


@pytest.mark.slow
@pytest.mark.parametrize("line", [c for c in COMMANDS if c.startswith("islandgp estimate")])
def test_every_estimate_of_the_document_runs(line: str) -> None:
    """And prints dollars."""
    result = CliRunner().invoke(command, shlex.split(line)[2:], catch_exceptions=False)
    assert result.exit_code == 0
    assert "US dollars" in result.output
    assert "unknown" not in result.output


def test_no_command_is_left_out() -> None:
    """The tests above and below know every sort of command that the document has."""
    programs = (
        "python -m islandgp ",
        "islandgp estimate",
        "islandgp transcript",
        "islandgp compare",
        "python -m tests.llm.demo",
        "export",
    )
    assert len(COMMANDS) > 8
    assert all(line.startswith(programs) for line in COMMANDS)


@pytest.mark.slow
def test_the_demo(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It needs no key, marks the answers as a mock's, and ends with two equal records."""
    monkeypatch.setattr(tempfile, "mkdtemp", lambda prefix: str(tmp_path / prefix))
    small = ("evaluator=serial", "gp.population=6", "world.episode.length=5")
    assert demo(small) == 0
    output = capsys.readouterr().out
    assert "the answers below are a mock's" in output
    assert "rate: llm" in output
    assert "repaired" in output
    assert output.rstrip().endswith("The two records are identical, byte for byte.")


def test_the_names_of_the_record_are_real() -> None:
    """Notes and ledger have the names of the document."""
    llm, _ = supervisor(answering(rate="no"))
    notes = advise(llm).notes
    for name in notes:
        assert f"`notes.{name}`" in TEXT
    for name in ("requests", "cost_usd"):
        assert name in llm.spent()
        assert f"`llm/{name}`" in TEXT
    stages = [stage.value for stage in RejectionStage if stage is not RejectionStage.REFUSED]
    assert all(re.search(rf"\b{stage}\b", TEXT, re.IGNORECASE) for stage in stages)


def variables(text: str) -> set[str]:
    """The names in double braces."""
    return set(re.findall(r"\{\{ ?([\w.]+) ?\}\}", text))


def test_the_variables_of_the_prompts_are_documented() -> None:
    """The table has each variable that can be used, and no others."""
    table = TEXT.partition("| variable | what it is |")[2].partition("\n\n")[0]
    assert {"rate.PHASE", "rate.least", "rate.most"} <= variables(table)
    documented = {name.partition(".")[0] for name in variables(table)}
    values = dict.fromkeys(documented, "")
    for name in PROMPT_SETS:
        adviser = Questions(settings(f"prompts={name}"), context())
        for prompt in adviser.prompts.values():
            prompt.variables(values)
    later = {"generation", "state", "urgency", "progress", "answer", "stage", "error"}
    phase = {"depth", "nodes", "explore", "exploit", "examples"}
    assert documented == {*adviser.values, *later, *RUN_VALUES, *EDIT_VALUES, *phase}


def test_prompts_are_of_no_domain() -> None:
    """They name no action, no key and no tier of the island."""
    names = {*VOCABULARY.actions, *VOCABULARY.keys, *(t.title() for t in composed().classes.tiers)}
    for file in resource("prompts").rglob("*.md"):
        text = file.read_text(encoding="utf-8")
        assert names.isdisjoint(re.findall(r"\w+", text))
