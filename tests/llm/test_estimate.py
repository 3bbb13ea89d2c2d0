"""`islandgp estimate`: what a sweep will cost, by arithmetic that can be followed."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from islandgp.commands.runs import estimate_command as command
from islandgp.errors import ConfigError
from islandgp.resources import resource
from islandgp.supervision.base import RunContext
from islandgp.supervision.llm.budget import ANSWER, THOUGHTS, Bill, SupervisedRuns, bills, costs
from islandgp.supervision.llm.prompts import PROMPT_SETS
from islandgp.supervision.llm.settings import LLMSettings
from tests.llm.samples import advise, answering, context, settings, state, supervisor


def expected(*arguments: Any) -> Bill:
    """The expected bill of a run with these settings and context."""
    return bills(run(*arguments))[0]


def at_most(*arguments: Any) -> Bill:
    """The upper bound of the same."""
    return bills(run(*arguments))[1]


def run(llm_settings: LLMSettings, run_context: RunContext) -> SupervisedRuns:
    return SupervisedRuns(llm_settings, run_context)


def output_of(*arguments: str) -> str:
    result = CliRunner().invoke(command, list(arguments), catch_exceptions=False)
    assert result.exit_code == 0
    return result.output


def test_every_generation_but_the_last_asks_twice() -> None:
    """41 generations: 80 questions and a probe, with so many tokens of answers."""
    bill = expected(settings(), context())
    assert bill.requests == 81
    assert bill.output_tokens == 80 * ANSWER
    assert bill.usd == pytest.approx((bill.input_tokens + 5 * bill.output_tokens) / 1e6)


def test_the_command_counts_the_questions_of_a_search() -> None:
    """Racing has no mutation rate to ask for."""
    for search, requests in (("paper", ["81", "492"]), ("racing", ["41", "252"])):
        text = output_of(f"search={search}", "supervisor=llm")
        assert re.findall(r"([\d,]+) requests", text) == requests


def test_at_most_counts_attempts_and_repairs() -> None:
    """3 attempts x 2 turns x 2 questions x 40 generations, and the probe's own."""
    bound = at_most(settings(), context())
    assert bound.requests == 3 * 2 * 2 * 40 + 3 * 4
    assert bound.output_tokens == 3 * 2 * 2 * 40 * 2048


def test_a_run_never_takes_more_than_the_most(tmp_path: Path) -> None:
    """Even one whose every answer is useless stays below."""
    run_context = replace(context(tmp_path), generations=4)
    llm, _ = supervisor(answering(rate="x" * 9000, tree="y" * 9000), run_context=run_context)
    for generation in range(3):
        advise(llm, state(generation))
    assert llm.calls is not None
    most = llm.calls.ledger.most()
    bound = at_most(llm.settings, run_context)
    assert most.requests <= bound.requests
    assert most.input_tokens <= bound.input_tokens


def test_the_command_estimates_a_sweep() -> None:
    """Five runs cost five times one; nothing is sent, no key is needed."""
    text = output_of("supervisor=llm", "seed=range(5)", "-m")
    assert "claude-haiku-4-5-20251001" in text
    one, five = (
        float(re.findall(r"([\d.,]+) US dollars", each)[0])
        for each in (output_of("supervisor=llm"), text)
    )
    assert math.isclose(five, 5 * one, rel_tol=0.1)


def test_the_command_counts_runs_without_a_model() -> None:
    """Free arms of a sweep are counted apart."""
    assert output_of("supervisor=expert").startswith("Nothing: none of the 1 runs")
    text = output_of("supervisor=llm,expert", "seed=range(2)", "-m")
    assert " in 2 runs, at most " in text
    assert "2 other runs ask no language model." in text


def test_the_estimate_is_near_what_was_measured() -> None:
    """Near the characters that docs/llm.md has of runs with the mock, both sets.

    The estimate is of a run five times as long, in which informed questions are longer.
    """
    text = (resource("conf").parent / "docs" / "llm.md").read_text(encoding="utf-8")
    line = text.partition("as measured in runs with the mock: ")[2].partition(".")[0]
    measured_sizes = dict(re.findall(r"([\d,]+) \((\w+)\)", line))
    assert set(measured_sizes.values()) == set(PROMPT_SETS)
    for size, name in measured_sizes.items():
        llm_settings, tolerance = settings(f"prompts={name}"), 0.05 if name == "paper" else 0.2
        measured = 40 * int(size.replace(",", "")) / llm_settings.facts.characters
        assert expected(llm_settings, context()).input_tokens == pytest.approx(
            measured, rel=tolerance
        )


def test_thoughts_are_expected_of_a_model_that_thinks() -> None:
    """THOUGHTS tokens before each answer, or as many as there is room for."""
    plain, thinking = (
        expected(settings(*overrides), context()) for overrides in ([], ["model=current-small"])
    )
    assert thinking.output_tokens - plain.output_tokens == 80 * THOUGHTS


def test_the_upper_bound_of_a_sweep() -> None:
    """It is printed before a sweep starts; a run's caps limit each run."""
    capped = settings("caps.requests=7", "caps.usd=0.5")
    runs = [SupervisedRuns(capped, context(), 3), run(capped, context())]
    line = costs(runs)
    assert " in 4 runs, at most 28 requests, " in line
    assert ", 2.00 US dollars; supervisor.policy.caps" in line
    assert ", an unknown price;" in costs([run(settings("model=mine"), context())])


def test_an_unknown_option_is_one_line() -> None:
    """As in the command that starts the runs, without the usage of the parser."""
    with pytest.raises(ConfigError, match="unrecognized arguments: --set"):
        output_of("supervisor=llm", "--set", "search=paper")
