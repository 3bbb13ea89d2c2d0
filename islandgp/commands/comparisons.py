"""Commands that compare the results of runs: `best` and `compare`."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import click

from islandgp.commands.files import FOLDER, OUTPUT, STDIN, check_place, unusable, write_text
from islandgp.commands.options import grouped, with_config_dir_option, with_workers_option
from islandgp.commands.tables import Column, compared_trees, print_table, standard_output
from islandgp.compare.champions import MOST, best_trees, runs_of_one_task, shortened_trees
from islandgp.compare.report import CompareOptions, build, select_study, write
from islandgp.evaluation.processes import Processes, cores
from islandgp.gate import cleaned
from islandgp.text import in_interval

TIMEOUT: Final = 600.0  # time limit of an episode of `best`, s


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--worlds", type=click.IntRange(2, 10_000), default=100, help="Number of test worlds."
)
@with_workers_option
@click.option("-o", "--output", type=OUTPUT, help="Write the winner to this file.")
@click.option(
    "--front", is_flag=True, help="Print the run's shortened trees, by size, and run no episode."
)
@click.option("--json", "as_json", is_flag=True, help="Print the rows as JSON.")
@with_config_dir_option
def best_command(
    run: Path, worlds: int, workers: int, output: str | None, front: bool, as_json: bool
) -> None:
    """Test the best robot of the finished run, or of the finished runs of a sweep, in folder RUN.

    The best robots of a sweep's runs, at most twenty, and the library's reference trees are
    evaluated in the same test worlds, which were used neither for training nor for selection. The
    first row is the robot with the highest mean in its run's validation.
    """
    found = runs_of_one_task(run)
    runs = [each for each in found if each.finished]
    if unfinished := [each.path.name for each in found if not each.finished]:
        names = cleaned(", ".join(unfinished))
        click.echo(f"islandgp: left out, as they are not finished: {names}", err=True)
    if front:
        rows = shortened_trees(runs)
        best = next(tree for tree in rows if tree["chosen"])
        columns = _front(rows)
        note = "Points in the same worlds, in which no tree was made; --json prints the trees."
    else:
        make = partial(Processes, workers=workers or cores(), episode_timeout=TIMEOUT)
        frame = best_trees(runs, make, worlds)
        frame["name"] = frame["name"].map(cleaned)
        rows = frame.to_dict("records")
        best, columns = rows[0], [*compared_trees(frame, worlds)]
        note = (
            f"Means over {worlds} test worlds of the last stage; differences are to the first tree."
            " Training and selection used other worlds."
        )
        if len(runs) > MOST:
            note += f"\nOf {len(runs)} runs, those {MOST} with the highest means in validation."
        if "perturbed" in frame:
            note += "\nPerturbed: mean and worst in the same worlds after their perturbation."
    if output is not None:
        write_text(output, best["tree"])
    if as_json:
        click.echo(json.dumps(rows, indent=2))
    elif output != STDIN:
        console = standard_output()
        print_table(console, columns)
        console.print(f"\n{note}")


def _front(trees: Sequence[Mapping[str, Any]]) -> list[Column]:
    """The columns of a front of size against points."""
    differences = [
        "" if (d := tree["difference"]) is None else in_interval(d["mean"], d["low"], d["high"])
        for tree in trees
    ]
    return [
        ("nodes", [tree["nodes"] for tree in trees]),
        ("to the longest (95 %)", differences),
        ("", ["best robot" if tree["chosen"] else "" for tree in trees]),
    ]


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
def compare_command(options: CompareOptions) -> None:
    """Compare arms of the runs in FOLDERS by tables, figures and statistics.

    Prints the result, and writes a page (index.html), CSV files and figures (SVG).
    """
    study, folder = select_study(options)
    check_place(folder, is_folder=True)
    make = partial(Processes, workers=options.workers or cores())
    report = build(study, options.primary, worlds=options.worlds, make=make)
    try:
        write(report, folder)
    except OSError as error:
        raise unusable(folder, error) from error
    click.echo(report.screen(folder))
