"""`islandgp best`: the best trees of a finished run or sweep, in unseen worlds."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, Final

import click

from islandgp.commands.files import OUTPUT, STDIN, write_text
from islandgp.commands.options import with_config_dir_option, with_workers_option
from islandgp.commands.tables import Column, print_table, standard_output
from islandgp.compare.best_trees import Row, best_rows
from islandgp.errors import RunError
from islandgp.evaluation.processes import Processes, cores
from islandgp.gate import cleaned
from islandgp.records.folder import RunFolder
from islandgp.records.parameters import TASK
from islandgp.text import in_interval, in_points, title

TIMEOUT: Final = 600.0  # time limit of an episode, s


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--tier", help="Only trees that reached this tier in training.")
@click.option(
    "--worlds",
    type=click.IntRange(2, 10_000),
    default=100,
    help="Number of test worlds in which the best trees are evaluated.",
)
@with_workers_option
@click.option("-o", "--output", type=OUTPUT, help="Write the winner to this file.")
@click.option(
    "--front", is_flag=True, help="Print the run's shortened trees, by size, and run no episode."
)
@click.option("--nodes", type=click.IntRange(1), help="Print the tree of --front of this size.")
@click.option("--json", "as_json", is_flag=True, help="Print the rows as JSON.")
@with_config_dir_option
def command(
    run: Path,
    tier: str | None,
    worlds: int,
    workers: int,
    output: str | None,
    front: bool,
    nodes: int | None,
    as_json: bool,
) -> None:
    """Find the best tree of the finished run, or the finished runs of a sweep, in the folder RUN.

    Candidates are all trees of the last stage, or the best robots of a sweep's runs. Successive
    halving in validation worlds selects three of them. These, the run's best robot and the
    library's reference trees are then evaluated in test worlds, which were used neither for
    training nor for selection.
    """
    if nodes is not None and not front:
        raise click.UsageError("expected --front with --nodes")
    if front and tier:
        raise click.UsageError("expected --tier without --front, which runs no episode")
    runs = _finished(run)
    if front:
        _show_front(runs, nodes, output, as_json)
        return
    make = partial(Processes, workers=workers or cores(), episode_timeout=TIMEOUT)
    rows = best_rows(runs, make, tier or "", worlds)
    if output is not None:
        write_text(output, rows[0].tree)
    if as_json:
        plain = [{k: v for k, v in asdict(row).items() if v is not None} for row in rows]
        click.echo(json.dumps(plain, indent=2))
    elif output != STDIN:
        _print(rows, worlds)


def _show_front(
    runs: Sequence[RunFolder], nodes: int | None, output: str | None, as_json: bool
) -> None:
    """Prints the front of size against points, or one of its trees.

    Raises:
        RunError: there is more than one run, no front, or no tree of that size.
    """
    if len(runs) > 1:
        raise RunError(f"Expected one run for --front, found {len(runs)}; give a run's own folder.")
    trees = runs[0].summary()["champion"]["front"]
    if not trees:
        raise RunError(
            f"Expected a front in {runs[0].path}, found none: its tree was not shortened."
        )
    by_size = {tree["nodes"]: tree for tree in reversed(trees)}  # of equal sizes the shortened one
    chosen = next(tree for tree in trees if tree["chosen"])
    if nodes is not None and nodes not in by_size:
        sizes = ", ".join(map(str, sorted(by_size)))
        raise RunError(f"--nodes: expected one of {sizes}, found {nodes}")
    tree = chosen if nodes is None else by_size[nodes]
    if output is not None:
        write_text(output, tree["tree"])
    if as_json:
        click.echo(json.dumps(trees, indent=2))
    elif nodes is not None and output is None:
        click.echo(tree["tree"], nl=False)
    elif output != STDIN:
        _print_front([by_size[size] for size in sorted(by_size)])


def _print_front(trees: Sequence[Mapping[str, Any]]) -> None:
    differences = [
        "" if (d := tree["difference"]) is None else in_interval(d["mean"], d["low"], d["high"])
        for tree in trees
    ]
    console = standard_output()
    columns = [
        Column("nodes", [str(tree["nodes"]) for tree in trees]),
        Column("to the longest (95 %)", differences),
        Column("", ["best robot" if tree["chosen"] else "" for tree in trees], left=True),
    ]
    print_table(console, columns)
    console.print(
        "\nPoints in the same worlds, in which no tree was made; --nodes N prints that tree."
    )


def _finished(path: Path) -> list[RunFolder]:
    """The run in a folder, or those of the sweep.

    Raises:
        RunError: there is none, or the fitness of two runs is not comparable.
    """
    one = RunFolder(path)
    if one.begun():
        one.about()  # a finished run that has lost its summary is damaged
    below = [RunFolder(child) for child in sorted(path.iterdir())] if path.is_dir() else []
    runs = [run for run in ([one] if one.finished() else below) if run.finished()]
    if not runs:
        raise RunError(f"Expected a finished run in {path}, found none; give a run's own folder.")
    if unfinished := [run.path.name for run in below if run.about() and not run.finished()]:
        click.echo(
            cleaned(f"islandgp: left out, as they are not finished: {', '.join(unfinished)}"),
            err=True,
        )
    first = runs[0].configuration()
    for run in runs[1:]:
        config = run.configuration()
        for group in sorted({*TASK, "constraints", "perturb"}):
            if (first.get(group) or {}) != (config.get(group) or {}):
                raise RunError(
                    f"Expected runs with the same {group}, found different ones in"
                    f" {runs[0].path.name} and {run.path.name}; give a run's own folder."
                )
    return runs


def _print(rows: Sequence[Row], worlds: int) -> None:
    def column(heading: str, form: Callable[[float], str], name: str) -> list[Column]:
        """A column of numbers, if the rows have them."""
        values: list[Any] = [getattr(row, name) for row in rows]
        return [] if None in values else [Column(heading, [*map(form, values)])]

    differences = [
        in_interval(row.difference, row.difference_low, row.difference_high) for row in rows[1:]
    ]
    console = standard_output()
    columns = [
        Column("tree", [cleaned(row.name) for row in rows], left=True),
        *column("points", in_points, "mean"),
        Column("95 % interval", [f"[{in_points(row.low)}, {in_points(row.high)}]" for row in rows]),
        *(
            Column(title(tier), [f"{row.reached[tier]:.0%}" for row in rows])
            for tier in rows[0].reached
        ),
        *column("constraints kept", "{:.0%}".format, "feasible"),
        *column("perturbed", in_points, "perturbed"),
        *column("worst", in_points, "perturbed_worst"),
        Column("to the first", ["", *differences]),
    ]
    print_table(console, columns)
    if rows[0].perturbed is not None:
        console.print("\nPerturbed: mean and worst in the same worlds after their perturbation.")
    console.print(
        f"\nMeans over {worlds} test worlds of the last stage;"
        " training and selection used other worlds."
    )
