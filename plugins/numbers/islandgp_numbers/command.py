"""`islandgp tune`: tunes the thresholds of a tree."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from time import monotonic
from typing import Final

import click

from islandgp.bt.core.printer import number_text
from islandgp.commands.files import FILE, read_tree_text, write_text
from islandgp.commands.options import (
    DomainOptions,
    with_domain_options,
    with_output_option,
    with_stage_option,
)
from islandgp.commands.setting import settings_of, stage_index
from islandgp.config.settings import Settings
from islandgp.errors import IslandError
from islandgp.viewer.recording import digits
from islandgp_numbers.tuning import (
    Evaluate,
    MeanInterval,
    NumberComparison,
    NumberSettings,
    Tuned,
    thresholds_of,
    tuned,
)

MAX_TUNED: Final = 100  # most numbers of a file that are tuned


@click.command(epilog="\b\nExample:\n  islandgp tune tree.bt")
@click.argument("file", type=FILE)
@with_output_option
@click.option(
    "--episodes",
    type=click.IntRange(1, 1_000_000),
    default=9_600,
    help="Maximum number of episodes: four fifths for the search, the rest to compare.",
)
@click.option(
    "--worlds",
    type=click.IntRange(2, 1_000),
    default=4,
    help="New worlds per generation of the search.",
)
@click.option(
    "--seed", type=click.IntRange(0), default=0, help="Seed of the worlds and the search."
)
@with_domain_options
@with_stage_option
def command(
    file: str,
    output: str,
    episodes: int,
    worlds: int,
    seed: int,
    options: DomainOptions,
    stage: int | None,
) -> None:
    """Tune the thresholds of the tree in FILE with CMA-ES, starting at its numbers.

    Everything else is unchanged: names of constants, comments, subtrees, counts of
    repeaters, numbers in `==` and `!=`, and included files. New numbers are written only if
    they are better in worlds that were not used to find them; the tree is printed, or written
    with -o. The comparison and the cost are reported on the standard error. Ctrl-C writes nothing.
    """
    source = text, name, folder = read_tree_text(file)
    settings = settings_of(source, options)
    index = stage_index(settings, stage)
    vocabulary = settings.problem().domain.schema.vocabulary
    source.tree(vocabulary)
    thresholds = thresholds_of(text, vocabulary, name=name, folder=folder)
    if not thresholds:
        click.echo(
            f"{name}: there is no number to tune: no key is compared with one by <, <=, > or >=.",
            err=True,
        )
        write_text(output, text)
        return
    if len(thresholds) > MAX_TUNED:
        raise IslandError(
            f"{name}: expected at most {MAX_TUNED} numbers to tune, found {len(thresholds)}; give"
            " those that belong together one name: constant NAME = NUMBER."
        )
    search = NumberSettings(episodes=episodes, worlds=worlds)
    _report_plan(search, len(thresholds))
    start = monotonic()
    with _episodes(settings, index, episodes) as (evaluate, progress):
        result = tuned(
            text,
            evaluate,
            vocabulary,
            search,
            seed=seed,
            name=name,
            folder=folder,
            progress=progress,
        )
    write_text(output, result.text)
    _report(result, monotonic() - start)


@contextmanager
def _episodes(
    settings: Settings, stage: int, episodes: int
) -> Iterator[tuple[Evaluate, Callable[[int], None]]]:
    """A function that returns the fitness of trees in worlds, with a progress bar."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    from islandgp.evaluation.base import evaluated
    from islandgp.running.parts import make_evaluator

    console = Console(stderr=True)
    columns = (BarColumn(20), MofNCompleteColumn(), TextColumn("episodes"))
    progress = Progress(*columns, console=console, disable=not console.is_terminal, transient=True)
    with closing(make_evaluator(settings)) as evaluator, progress as bar:
        task = bar.add_task("", total=episodes)

        def points(trees: Sequence[str], worlds: Sequence[int]) -> list[list[float]]:
            results = evaluated(evaluator, trees, stage, worlds)
            return [[outcome.fitness for outcome in outcomes] for outcomes in results]

        yield points, lambda done: bar.update(task, completed=done)


def _report_plan(settings: NumberSettings, numbers: int) -> None:
    """The budget of the search. Raises ConfigError if there are too few episodes."""
    plan = settings.plan(numbers)
    click.echo(
        f"{numbers} {'number' if numbers == 1 else 'numbers'} to tune in at most"
        f" {settings.episodes:,} episodes: {plan.generations} generations of {plan.population}"
        f" trees in {settings.worlds} worlds, a race, a comparison in {plan.comparing} worlds.",
        err=True,
    )


def _report(tuned: Tuned, seconds: float) -> None:
    """A line for each number, the comparison, and the cost."""
    for threshold, value in zip(tuned.thresholds, tuned.values, strict=True):
        number = threshold.number
        became = "stays" if value == number.value else f"becomes {number_text(value)}"
        click.echo(
            f"  line {number.line}: {number.label} {number_text(number.value)} {became}", err=True
        )
    if tuned.comparison is None:
        click.echo("Nothing better was found: the written numbers won the race.", err=True)
    else:
        click.echo("\n".join(_comparison_lines(tuned.comparison)), err=True)
    costs = tuned.costs
    click.echo(
        f"Cost: {costs.total:,} episodes ({costs.search:,} search, {costs.race:,} race,"
        f" {costs.comparison:,} comparison), {seconds:.1f} s.",
        err=True,
    )


def _comparison_lines(comparison: NumberComparison) -> Iterator[str]:
    """Means and the paired difference, each with its 95 % interval."""
    places = digits([*comparison.written, *comparison.tuned])

    def interval(mean: MeanInterval, sign: str = "") -> str:
        middle, low, high = (f"{end:{sign},.{places}f}" for end in mean)
        return f"{middle} points (95 %: {low} to {high})"

    yield f"In {comparison.worlds} worlds that were not used before:"
    yield f"  before: {interval(comparison.written)}"
    yield f"  after: {interval(comparison.tuned)}"
    difference = interval(comparison.difference, "+")
    yield f"  difference: {difference}, better in {comparison.better} worlds"
    if not comparison.accepted:
        yield "Nothing better was found: the difference may be chance. The numbers are unchanged."
