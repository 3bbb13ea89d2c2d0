"""`islandgp best`: the best trees of a finished run or sweep, in unseen worlds."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from islandgp.commands.files import OUTPUT, STDIN, write_text
from islandgp.commands.options import with_config_dir_option, with_workers_option
from islandgp.commands.tables import Column, print_table, standard_output
from islandgp.compare.best_trees import best_trees, finished_runs, shortened_trees
from islandgp.errors import RunError
from islandgp.evaluation.processes import Processes, cores
from islandgp.gate import cleaned
from islandgp.text import in_interval, in_points, title

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped] # its stubs are a package apart

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
@click.option("--nodes", type=click.IntRange(1), help="Print the shortened tree of this size.")
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
    if (front or nodes) and tier:
        raise click.UsageError("expected --tier without --front, which runs no episode")
    runs, unfinished = finished_runs(run)
    if unfinished:
        names = cleaned(", ".join(unfinished))
        click.echo(f"islandgp: left out, as they are not finished: {names}", err=True)
    if front or nodes:
        trees = shortened_trees(runs)
        sizes = {tree["nodes"]: tree for tree in trees}
        if nodes is not None and nodes not in sizes:
            raise RunError(f"--nodes: expected one of {', '.join(map(str, sizes))}, found {nodes}")
        best = next(t for t in trees if t["chosen"]) if nodes is None else sizes[nodes]
        rows, table = trees, _front_table(trees)
        if nodes is not None and output is None and not as_json:
            output = STDIN
    else:
        make = partial(Processes, workers=workers or cores(), episode_timeout=TIMEOUT)
        frame = best_trees(runs, make, tier or "", worlds)
        rows, table = frame.to_dict("records"), _table(frame, worlds)
        best = rows[0]
    if output is not None:
        write_text(output, best["tree"])
    if as_json:
        click.echo(json.dumps(rows, indent=2))
    elif output != STDIN:
        columns, note = table
        console = standard_output()
        print_table(console, columns)
        console.print(note)


def _front_table(trees: Sequence[Mapping[str, Any]]) -> tuple[list[Column], str]:
    """The columns of a front of size against points, and a note below them."""
    differences = [
        "" if (d := tree["difference"]) is None else in_interval(d["mean"], d["low"], d["high"])
        for tree in trees
    ]
    columns = [
        Column("nodes", [str(tree["nodes"]) for tree in trees]),
        Column("to the longest (95 %)", differences),
        Column("", ["best robot" if tree["chosen"] else "" for tree in trees], left=True),
    ]
    return columns, (
        "\nPoints in the same worlds, in which no tree was made; --nodes N prints that tree."
    )


def _table(rows: DataFrame, worlds: int) -> tuple[list[Column], str]:
    """The columns of the best trees, and a note below them."""

    def column(heading: str, form: Callable[[float], str], name: str) -> list[Column]:
        """A column of numbers, if the rows have them."""
        return [Column(heading, [*map(form, rows[name])])] if name in rows else []

    ends = zip(rows["difference"], rows["difference_low"], rows["difference_high"], strict=True)
    intervals = [
        f"[{in_points(a)}, {in_points(b)}]" for a, b in zip(rows["low"], rows["high"], strict=True)
    ]
    columns = [
        Column("tree", [*map(cleaned, rows["name"])], left=True),
        *column("points", in_points, "points"),
        Column("95 % interval", intervals),
        *(
            Column(title(name.removeprefix("reached.")), [f"{share:.0%}" for share in rows[name]])
            for name in rows
            if name.startswith("reached.")
        ),
        *column("constraints kept", "{:.0%}".format, "feasible"),
        *column("perturbed", in_points, "perturbed"),
        *column("worst", in_points, "perturbed_worst"),
        Column("to the first", ["", *(in_interval(*each) for each in [*ends][1:])]),
    ]
    perturbed = "\nPerturbed: mean and worst in the same worlds after their perturbation.\n"
    return columns, perturbed * ("perturbed" in rows) + (
        f"\nMeans over {worlds} test worlds of the last stage;"
        " training and selection used other worlds."
    )
