"""`islandgp judge`: the arms, their one difference, the plan, the budget, and going on."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from islandgp.bt.core.language import parse, to_text
from islandgp.commands.setting import configured
from islandgp.errors import ConfigError, IslandError, RunError
from islandgp.supervision.editor import EditorSettings
from islandgp.supervision.llm.settings import LLMSettings
from islandgp.supervision.llm.transcript import Transcript
from islandgp_judge import judge as judge_module
from islandgp_judge.command import command
from islandgp_judge.judge import (
    ASKED,
    FREE,
    POPULATIONS,
    EditResult,
    Judge,
    case_of,
    chosen,
    plan,
    read_populations,
    verdict,
)
from tests.llm.server import MessagesServer

RECORDED = read_populations(POPULATIONS)
CARTPOLE = ("--domain", "cartpole", "--populations", "4")


@pytest.fixture
def judged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Result]:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(judge_module, "WORLDS", 3)

    def run(*arguments: str) -> Result:
        return CliRunner().invoke(command, list(arguments), catch_exceptions=True)

    return run


def judge_of(number: int, domain: str = "cartpole") -> tuple[Judge, LLMSettings]:
    run = configured([f"domain={domain}", "supervisor=llm", "supervisor.policy.parents=1"])
    editor, policy = (
        configured(["supervisor=editor"]).supervisor.settings(),
        run.supervisor.settings(),
    )
    assert isinstance(editor, EditorSettings)
    assert isinstance(policy, LLMSettings)
    indices = chosen(RECORDED, number, [domain])
    return Judge([case_of(k, RECORDED[k], run) for k in indices], editor), policy


def test_two_hundred_populations_of_three_domains_are_shipped() -> None:
    """In a small file, balanced in any number."""
    assert len(RECORDED) == 200
    domains = ["island", "lunarlander", "cartpole"]
    assert {p.domain for p in RECORDED} == set(domains)
    assert POPULATIONS.stat().st_size < 50_000
    first = [RECORDED[k].domain for k in chosen(RECORDED, 30, domains)]
    assert all(first.count(domain) == 10 for domain in domains)
    assert len(set(chosen(RECORDED, 200, domains))) == 200
    for domain in domains:
        vocabulary = configured([f"domain={domain}"]).make_domain().schema.vocabulary
        for population in RECORDED[::4]:
            if population.domain == domain:
                assert all(to_text(parse(t, vocabulary)) == t for t in population.trees)


def test_the_free_arms(judged: Callable[..., Result], tmp_path: Path) -> None:
    """A plan with its digest before, a line for each edit, a verdict; the same bytes again."""
    first = judged(*CARTPOLE)
    assert first.exit_code == 0, first.output
    assert "4 populations of cartpole; detects a difference of 1.40 standard" in first.output
    assert "No model was asked" in first.output
    files = {p.name: p.read_bytes() for p in (tmp_path / "judge").iterdir()}
    assert set(files) == {"plan.json", "results.csv", "verdict.md"}
    rows = list(csv.DictReader(files["results.csv"].decode().splitlines()))
    assert [row["arm"] for row in rows] == [arm for arm in FREE for _ in range(4)]
    assert json.loads(files["plan.json"])["worlds"] == 3
    assert judged(*CARTPOLE).output == first.output
    assert {p.name: p.read_bytes() for p in (tmp_path / "judge").iterdir()} == files


@pytest.mark.slow
def test_a_model_is_asked_and_the_command_goes_on(
    judged: Callable[..., Result], tmp_path: Path
) -> None:
    """Three arms with transcripts; what is answered is not asked again."""
    with MessagesServer() as server:
        model = ("supervisor=llm", f"supervisor.policy.base_url={server.url}")
        first = judged(*CARTPOLE, "--budget", "1", *model)
        assert first.exit_code == 0, first.output
        asked = len(server.requests)
        assert asked >= 3 * (1 + 4)
        assert "true against shuffled: " in first.output
        assert "stage 2" in first.output.lower()
        again = judged(*CARTPOLE, "--budget", "1", *model)
        assert len(server.requests) == asked
    assert again.output == first.output
    for arm in ASKED:
        assert len(Transcript(tmp_path / "judge" / f"{arm}.jsonl").parts) == 4


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (("--domain", "moon"), "--domain: expected one of island, lunarlander, cartpole"),
        (
            (*CARTPOLE, "supervisor=llm", "supervisor.policy.base_url=http://x:1"),
            r"--budget: expected at least 0\.\d+ US dollars for two populations",
        ),
        (
            (*CARTPOLE, "--budget", "1", "supervisor=llm", "supervisor.policy.model=mine"),
            "--budget: expected 0, as no price of mine is known",
        ),
    ],
)
def test_wrong_options_are_one_line(
    judged: Callable[..., Result], arguments: tuple[str, ...], error: str
) -> None:
    """Before anything is written or sent."""
    result = judged(*arguments)
    assert isinstance(result.exception, ConfigError)
    with pytest.raises(IslandError, match=error):
        raise result.exception
    assert not Path("judge").exists()


def test_a_folder_has_one_plan(judged: Callable[..., Result]) -> None:
    """Results of two plans are not mixed."""
    assert judged(*CARTPOLE).exit_code == 0
    result = judged("--domain", "cartpole", "--populations", "3")
    assert isinstance(result.exception, RunError)
    assert "Expected the same plan in" in str(result.exception)


def test_the_arms_differ_in_one_thing() -> None:
    """The same system prompt and tree; other points and episodes, or no episodes."""
    judge, policy = judge_of(2)
    case, other = judge.cases
    of = {arm: judge.question(arm, case, policy)[1] for arm in ASKED}
    assert len({request.system for request in of.values()}) == 1
    tree = [line for line in of["true"].turns[0].splitlines() if line.startswith("  at ")]
    for request in of.values():
        lines = request.turns[0].splitlines()
        assert [line for line in lines if line.startswith("  at ")] == tree
        assert f"Individual {case.parent.id}: " in request.turns[0]
    for arm, shown in (("true", case), ("shuffled", other)):
        assert f"{case.parent.id}: {shown.parent.fitness:,.0f} points" in of[arm].turns[0]
    assert "In an episode of" not in of["blind"].turns[0]
    assert plan(judge, policy) == plan(judge, policy)
    assert plan(judge, policy)[0]["prompts"] != plan(judge_of(3)[0], policy)[0]["prompts"]


@pytest.mark.parametrize(("gain", "helps"), [(1.0, True), (0.0, False), (-1.0, False)])
def test_the_verdict_is_by_the_paired_test(gain: float, helps: bool) -> None:
    """Whole runs only if the true state is above the shuffled one."""
    judge, _ = judge_of(8)
    for k, case in enumerate(judge.cases):
        for arm, after in (("true", 100.0 + k + gain * (1 + k)), ("shuffled", 100.0 + k)):
            judge.results.append(EditResult(arm, case.index, "cartpole", "llm", 100, after, "Rest"))
    assert ("Stage 2 is worth its cost" in verdict(judge)[-1].replace("\n", " ")) is helps
