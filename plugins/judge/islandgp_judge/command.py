"""`islandgp judge`: does a model's judgement help, and does it use what it is shown?"""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from pathlib import Path

import click

from islandgp.commands.setting import configured
from islandgp.config.settings import Settings
from islandgp.errors import ConfigError
from islandgp.supervision.editor import EditorSettings
from islandgp.supervision.llm.client import client_of
from islandgp.supervision.llm.settings import LLMSettings
from islandgp.supervision.llm.supervisor import LLM
from islandgp_judge.judge import (
    HEAD,
    POPULATIONS,
    Judge,
    case_of,
    chosen,
    plan,
    read_populations,
    shortest_difference,
    verdict,
    write_plan,
    write_results,
)


@click.command(
    context_settings={"ignore_unknown_options": True, "help_option_names": ["-h", "--help"]},
    epilog="\b\nExample:\n  islandgp judge supervisor=llm --budget 2",
)
@click.option("--budget", type=click.FloatRange(0), default=0.0, help="Most US dollars to spend.")
@click.option("--populations", type=click.IntRange(2, 200), default=200, help="At most.")
@click.option("--domain", "domains", multiple=True, help="Only populations of this domain.")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), default=Path("judge"), help="Folder."
)
@click.argument("overrides", nargs=-1, type=click.UNPROCESSED)
def command(
    overrides: tuple[str, ...],
    budget: float,
    populations: int,
    domains: tuple[str, ...],
    output: Path,
) -> None:
    """Judge a supervisor by edits of recorded populations, e.g. supervisor=llm --budget 2.

    Each arm edits the same tree of each population once; the edited tree and the tree before run in
    the same 20 fresh worlds. The model is asked with the true state, with another population's
    and without episodes; rules, random branches and grammar walks are free. The same command
    continues a stopped one.
    """
    recorded = read_populations(POPULATIONS)
    known = list(dict.fromkeys(p.domain for p in recorded))
    for name in domains:
        if name not in known:
            raise ConfigError(f"--domain: expected one of {', '.join(known)}, found {name!r}")
    by_domain = {name: _settings(overrides, name) for name in domains or known}
    policies = [settings.supervisor.settings() for settings in by_domain.values()]
    policy = policies[0] if isinstance(policies[0], LLMSettings) else None
    editor = configured(["supervisor=editor"]).supervisor.settings()
    assert isinstance(editor, EditorSettings)

    def judge_of(number: int) -> Judge:
        indices = chosen(recorded, number, list(by_domain))
        cases = [case_of(k, recorded[k], by_domain[recorded[k].domain]) for k in indices]
        return Judge(cases, editor)

    judge = judge_of(populations)
    if policy is not None:
        judge, policy = _affordable(judge, policy, budget)
    digest = write_plan(plan(judge, policy)[0], output)
    n = len(judge.cases)
    click.echo(
        f"{n} populations of {', '.join(by_domain)}; detects a difference of"
        f" {shortest_difference(n):.2f} standard deviations with probability 80 %.\n"
        f"Plan: {output / 'plan.json'}, SHA-256 {digest}\n\n{HEAD}"
    )
    judge.free(click.echo)
    if policy is not None:
        LLM.check(policy, judge.cases[0].context)
        judge.ask(policy, client_of(policy), output, click.echo)
    write_results(judge, output)
    rest = verdict(judge)
    click.echo("\n".join(rest[rest.index("") :]))


def _settings(overrides: Sequence[str], domain: str) -> Settings:
    """The settings of a run in a domain; the model is shown one tree."""
    settings = configured([*overrides, f"domain={domain}"])
    policy = settings.supervisor.settings()
    if isinstance(policy, LLMSettings):
        return configured([*overrides, f"domain={domain}", "supervisor.policy.parents=1"])
    rest = [each for each in overrides if not each.startswith("supervisor")]
    return configured([*rest, f"domain={domain}", "supervisor=editor"])


def _affordable(judge: Judge, policy: LLMSettings, budget: float) -> tuple[Judge, LLMSettings]:
    """As many populations as the budget is expected to pay for, and the policy with its cap.

    Raises:
        ConfigError: the price is unknown, or the budget is too small.
    """
    if policy.price is None:
        if budget:
            raise ConfigError(
                f"--budget: expected 0, as no price of {policy.model_name} is known; add it to"
                " supervisor.policy.prices.models if it costs something"
            )
        return judge, policy
    _, bill = plan(judge, policy)
    number = len(judge.cases)
    affordable = min(number, int(number * budget / bill.usd)) if not isnan(bill.usd) else number
    domains = len({case.domain for case in judge.cases})
    click.echo(f"Expected: {bill.usd:,.2f} US dollars for {number} populations.")
    if affordable < 2 * domains:
        raise ConfigError(
            f"--budget: expected at least {2 * domains * bill.usd / number:,.2f} US dollars for two"
            f" populations of each domain, found {budget:g}"
        )
    caps = policy.caps.model_copy(update={"usd": budget / 3})
    return Judge(judge.cases[:affordable], judge.editor), policy.model_copy(update={"caps": caps})
