"""`islandgp compare`: compares arms by tables, figures and statistics."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import click

from islandgp.commands.files import FOLDER, check_place, unusable
from islandgp.commands.options import grouped, with_config_dir_option, with_workers_option
from islandgp.compare.report import CompareOptions, build, select_study, write
from islandgp.evaluation.processes import Processes, cores

EPILOG = """\b
Without --arm, the arms are those of the sweep: runs that differ only in seed.
--arm takes an arm's name as it is printed, or NAME="SELECTION": a list of
KEY=VALUE of the configuration, separated by spaces:
  --arm expert="supervisor=expert" --arm baseline="supervisor=baseline"
  --arm a="name=study seed=range(30) supervisor=llm" --arm b="my_sweep"
A bare word in a selection is a sweep's name.
"""

OPTIONS = (
    with_workers_option,
    click.option(
        "--worlds",
        type=click.IntRange(0, 10_000),
        default=100,
        help="Unseen worlds for the best robots; 0: none.",
    ),
    click.option(
        "--force", is_flag=True, help="Compare arms that are not comparable, with a warning."
    ),
    click.option(
        "--margin",
        "margins",
        multiple=True,
        metavar="MEASURE=VALUE",
        help="Largest difference at which arms count as equivalent.",
    ),
    click.option(
        "--primary",
        metavar="MEASURE",
        help="Primary endpoint: one test of the first two arms, not adjusted.",
    ),
    click.option(
        "-o",
        "--out",
        type=FOLDER,
        help="Folder for the report.  [default: study/<arms>, study/<sweep> without --arm]",
    ),
    click.option(
        "--arm",
        "arms",
        multiple=True,
        metavar='NAME="SELECTION"',
        help="One arm.  [default: each arm of the sweep]",
    ),
    click.option("--name", help="Use only the runs of this sweep."),
    click.option(
        "--runs",
        type=click.Path(path_type=Path),
        multiple=True,
        help="Folder of the runs; several: --runs A --runs B, or --runs A B.  [default: runs]",
    ),
    click.argument("folders", nargs=-1, type=click.Path(path_type=Path)),
)


@click.command(epilog=EPILOG)
@grouped("options", CompareOptions, *OPTIONS)
@with_config_dir_option
def command(options: CompareOptions) -> None:
    """Compare arms of the runs in FOLDERS by tables, figures and statistics.

    Prints the result, and writes a page (index.html), CSV files and figures (SVG).
    """
    study, plan, folder = select_study(options)
    check_place(folder, is_folder=True)
    make = partial(Processes, workers=options.workers or cores())
    report = build(study, plan, worlds=options.worlds, make=make)
    try:
        write(report, folder)
    except OSError as error:
        raise unusable(folder, error) from error
    click.echo(report.screen(folder))
