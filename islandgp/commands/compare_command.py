"""`islandgp compare`: compares arms by the paper's tables, figures and statistics."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import click

from islandgp.commands.files import FOLDER, check_folder, unusable
from islandgp.commands.options import with_trust_options, with_workers_option
from islandgp.evaluation.processes import Processes, cores
from islandgp.study.arms import Arm
from islandgp.study.comparable import compare_arms
from islandgp.study.generalise import controls as evaluate_controls
from islandgp.study.generalise import generalise, reference_trees
from islandgp.study.plan import check_plan, parse_plan
from islandgp.study.report import ComparisonReport, build
from islandgp.study.select import RunEntry, arms_of_sweep, find, named, parse_arm, select
from islandgp.study.table import Table
from islandgp.study.tables.claims import comparison_verdict, estimate_cells
from islandgp.study.writing import write

EPILOG = """\b
Without --arm, the arms are those of the sweep: runs that differ only in seed.
A selection is a list of KEY=VALUE of the configuration, separated by spaces:
  --arm expert="supervisor=expert" --arm baseline="supervisor=baseline"
  --arm a="name=study seed=range(30) supervisor=llm" --arm b="my_sweep"
A bare word is a sweep's name.
"""


@click.command(epilog=EPILOG)
@click.option(
    "--arm",
    "arms",
    multiple=True,
    metavar='NAME="SELECTION"',
    help="One arm.  [default: each arm of the sweep]",
)
@click.option(
    "--runs", type=click.Path(path_type=Path), default=Path("runs"), help="Folder of the runs."
)
@click.option("--name", default=None, help="Use only the runs of this sweep.")
@click.option(
    "-o",
    "--out",
    type=FOLDER,
    default=None,
    help="Folder for the report.  [default: study/<arms>, study/<sweep> without --arm]",
)
@click.option(
    "--primary",
    default=None,
    metavar="MEASURE",
    help="Primary endpoint: one test of the first two arms, not adjusted.",
)
@click.option(
    "--family",
    "families",
    multiple=True,
    metavar="NAME=ARM,ARM,...",
    help="Arms of one question, adjusted together.  [default: the arms that inject trees]",
)
@click.option(
    "--margin",
    "margins",
    multiple=True,
    metavar="MEASURE=VALUE",
    help="Largest difference at which arms count as equivalent.",
)
@click.option("--force", is_flag=True, help="Compare arms that are not comparable, with a warning.")
@click.option(
    "--worlds",
    type=click.IntRange(0, 10_000),
    default=100,
    help="Unseen worlds for the best robots; 0: none.",
)
@click.option(
    "--controls/--no-controls",
    default=True,
    help="Evaluate the library's trees in the runs' worlds.",
)
@with_workers_option
@with_trust_options
def command(
    arms: tuple[str, ...],
    runs: Path,
    name: str | None,
    out: Path | None,
    primary: str | None,
    families: tuple[str, ...],
    margins: tuple[str, ...],
    force: bool,
    worlds: int,
    controls: bool,
    workers: int,
) -> None:
    """Compare arms of runs: the paper's tables, figures and statistics.

    Writes one page (index.html), Markdown, CSV and figures (SVG, PNG).
    """
    plan = parse_plan(families, primary, margins)
    selections = [parse_arm(arm) for arm in arms]
    if selections:
        study_arms, notes = _select(selections, runs, name)
    else:
        study_arms, notes = arms_of_sweep(_available(runs, name))
    study = compare_arms(study_arms, force=force, notes=notes, sources=[str(runs)])
    check_plan(plan, study)
    title = "-".join(arm.name for arm in study.arms) if selections else study.arms[0].runs[0].name
    folder = out or Path("study") / title
    check_folder(folder)
    make = partial(Processes, workers=workers or cores())
    references = reference_trees(study)
    unseen = generalise(study, make, worlds=worlds, reference_trees=references) if worlds else ()
    report = build(study, unseen, worlds, evaluate_controls(study, make) if controls else (), plan)
    try:
        write(report, study, folder)
    except OSError as error:
        raise unusable(folder, error) from error
    notes = [f"not comparable: {doubt}" for doubt in study.comparability_warnings]
    notes += [f"note: {note}" for note in study.notes]
    click.echo("\n".join([*notes, *_results(report)]))
    click.echo(f"\n{folder / 'index.html'}: the page; beside it report.md, tables/, figures/")


def _select(
    selections: list[tuple[str, str]], runs: Path, name: str | None
) -> tuple[list[Arm], list[str]]:
    """The arms, with notes on omitted runs."""
    study_arms: list[Arm] = []
    notes: list[str] = []
    available = _available(runs, name)
    for arm, selection in selections:
        selected, remarks = select(arm, selection, available)
        study_arms.append(selected)
        notes += remarks
    return study_arms, notes


def _available(runs: Path, name: str | None) -> list[RunEntry]:
    """The runs in a folder, of one sweep if it is named."""
    return find(runs) if name is None else named(name, find(runs))


def _results(report: ComparisonReport) -> list[str]:
    """The primary endpoint, the first two arms and further questions, as lines for a terminal."""
    lines: list[str] = []
    for table in report.tables:
        if table.key == "primary" or table.key.startswith("questions"):
            lines += ["", table.title, *_lines(table)]
    return [*lines, *_tests(report)]


def _lines(table: Table) -> Iterator[str]:
    for cells in table.rows:
        row = dict(zip(table.columns, cells, strict=True))
        if table.key == "primary":
            question, p = row["unit"], f"p {row['p, not adjusted']}"
        else:
            question = f"{row['Arms']}: {row['measure']}"
            p = f"p BH {row['p BH']}"
        yield f"  {question:<47} {row['difference [95 %]']:>28}  {p:<13} {row['verdict']}"


def _tests(report: ComparisonReport) -> Iterator[str]:
    findings = [f for f in report.findings if f.family == report.findings[0].family]
    yield from ("", f"{findings[0].arms[0]} minus {findings[0].arms[1]}")
    for f in findings:
        difference = dict(estimate_cells(f))["difference [95 %]"]
        verdict = comparison_verdict(f, None)
        yield f"  {f.measure.label:<47} {difference:>28}  p BH {f.p_bh:.3f}  {verdict}"
