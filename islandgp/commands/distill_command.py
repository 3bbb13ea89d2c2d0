"""`islandgp distill`: a small offline policy from the decisions of past runs."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import click

from islandgp.commands.files import FOLDER, unusable
from islandgp.commands.options import with_trust_options
from islandgp.errors import StudyError
from islandgp.records.folder import RunFolder
from islandgp.study.distill import Case, Shape, distil, report_lines
from islandgp.supervision.distilled import NAME, features, rules
from islandgp.trust import must_trust_code


@click.command()
@click.argument("runs", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
@click.option("-o", "--out", type=FOLDER, required=True, help="Folder for the policy.")
@click.option("--depth", type=click.IntRange(1, 20), default=6, help="Maximum depth of a tree.")
@click.option(
    "--cases", type=click.IntRange(1), default=4, help="Minimum number of decisions in a leaf."
)
@with_trust_options
def command(runs: tuple[Path, ...], out: Path, depth: int, cases: int) -> None:
    """Fit a decision tree to the decisions in RUNS, folders with finished runs.

    States and decisions are read from the records. Use the policy with supervisor=distilled
    supervisor.policy.folder=FOLDER. The command needs islandgp[distill].
    """
    if find_spec("sklearn") is None:
        raise StudyError(
            "Expected scikit-learn, found none; install it with pip install 'islandgp[distill]'."
        )
    folders = [RunFolder(file.parent) for top in runs for file in sorted(top.rglob("config.yaml"))]
    finished = list({f.path.resolve(): f for f in folders if f.finished()}.values())
    if not finished:
        raise StudyError(f"Expected finished runs in {', '.join(map(str, runs))}, found none.")
    teachers = {str(folder.configuration()["supervisor"]["name"]) for folder in finished}
    if len(teachers) > 1:
        raise StudyError(
            f"Expected the runs of one supervisor, found those of {', '.join(sorted(teachers))};"
            " name the folders of one of them."
        )
    cases_of_runs = [case for number, run in enumerate(finished) for case in _cases(number, run)]
    if len({frozenset(case.known) for case in cases_of_runs}) > 1:
        raise StudyError(
            "Expected runs whose states have the same fields, found others; give runs with one"
            " domain and the same classes."
        )
    policy = distil(cases_of_runs, teachers.pop(), Shape(depth, cases))
    file = out / NAME
    lines = ["The target:", *rules(policy.target), "", "The rate:", *rules(policy.rate)]
    try:
        out.mkdir(parents=True, exist_ok=True)
        file.write_text(policy.model_dump_json(indent=1) + "\n", encoding="utf-8")
        (out / "rules.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise unusable(out, error) from error
    click.echo("\n".join(report_lines(policy)))
    click.echo(f"The policy: {file}; in words: {out / 'rules.txt'}")


def _cases(number: int, run: RunFolder) -> Iterator[Case]:
    """The decisions of a run's supervisor; those of its fallback are left out."""
    from islandgp.config.settings import read_settings
    from islandgp.evolution.loop import state_of_population

    config = run.configuration()
    must_trust_code(config)
    settings = read_settings(config)
    plan = settings.plan(settings.make_domain())
    records = list(run.generations())
    history = [record.snapshot for record in records]
    for record in records:
        guidance = record.guidance
        if guidance is None or guidance.asked_at is None or guidance.source == "fallback":
            continue
        state = state_of_population(plan, history[: guidance.asked_at + 1])
        tree = guidance.tree is not None and not _fell_back(guidance.notes, "tree")
        rate = not _fell_back(guidance.notes, "rate")
        yield Case(
            run=number,
            known=features(state, plan.gp.crisis),
            target=guidance.target if tree else None,
            rate=guidance.wanted_rate if rate else None,
        )


def _fell_back(notes: dict[str, Any], part: str) -> bool:
    return str(notes.get(part, "")).startswith("fallback")
