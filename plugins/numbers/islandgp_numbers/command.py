"""`islandgp tune`: tunes the thresholds of a tree."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from time import monotonic
from typing import Final

import click

from islandgp.bt.core.printer import number_text
from islandgp.commands.files import FILE, write_text
from islandgp.commands.options import DomainOptions, with_episode_options, with_output_option
from islandgp.commands.setting import tree_task
from islandgp.errors import IslandError
from islandgp.viewer.recording import digits
from islandgp_numbers.tuning import MeanInterval, NumberSettings, Tuned, thresholds_of, tuned

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
@with_episode_options
def command(
    file: str, output: str, episodes: int, worlds: int, seed: int, options: DomainOptions
) -> None:
    """Tune the thresholds of the tree in FILE with CMA-ES, starting at its numbers.

    Everything else is unchanged: names of constants, comments, subtrees, counts of
    repeaters, numbers in `==` and `!=`, and included files. New numbers are written only if
    they are better in worlds that were not used to find them; the tree is printed, or written
    with -o. The comparison and the cost are reported on the standard error. Ctrl-C writes nothing.
    """
    start = monotonic()
    task = tree_task(file, options)
    with task.trials(episodes) as trials:
        text, name, folder = task.source
        vocabulary = task.problem.domain.schema.vocabulary
        thresholds = thresholds_of(text, vocabulary, name=name, folder=folder)
        if not 0 < len(thresholds) <= MAX_TUNED:
            raise IslandError(
                f"{name}: expected 1 to {MAX_TUNED} numbers to tune (keys compared by <, <=, > or"
                f" >=), found {len(thresholds)}; give those that belong together one name: constant"
                " NAME = NUMBER."
            )
        search = NumberSettings(episodes=episodes, worlds=worlds)
        plan = search.plan(len(thresholds))
        click.echo(
            f"Numbers to tune: {len(thresholds)}, in at most {episodes:,} episodes:"
            f" {plan.generations} generations of {plan.population} trees in {worlds} worlds, a"
            f" race, a comparison in {plan.comparing} worlds.",
            err=True,
        )

        def points(trees: Sequence[str], seeds: Sequence[int]) -> list[list[float]]:
            return [[o.fitness for o in own] for own in trials(trees, seeds)]

        result = tuned(text, points, vocabulary, search, seed=seed, name=name, folder=folder)
    write_text(output, result.text)
    for line in _report(result, monotonic() - start):
        click.echo(line, err=True)


def _report(tuned: Tuned, seconds: float) -> Iterator[str]:
    """A line for each number, the comparison with 95 % intervals, and the cost."""
    for threshold, value in zip(tuned.thresholds, tuned.values, strict=True):
        number = threshold.number
        became = "stays" if value == number.value else f"becomes {number_text(value)}"
        yield f"  line {number.line}: {number.label} {number_text(number.value)} {became}"
    if (comparison := tuned.comparison) is not None:
        places = digits([*comparison.written, *comparison.tuned])

        def interval(mean: MeanInterval, sign: str = "") -> str:
            middle, low, high = (f"{end:{sign},.{places}f}" for end in mean)
            return f"{middle} points (95 %: {low} to {high})"

        yield f"In {comparison.worlds} worlds that were not used before:"
        yield f"  before: {interval(comparison.written)}"
        yield f"  after: {interval(comparison.tuned)}"
        difference = interval(comparison.difference, "+")
        yield f"  difference: {difference}, better in {comparison.better} worlds"
    if comparison is None or not comparison.accepted:
        yield "Nothing better was found. The numbers are unchanged."
    costs = tuned.costs
    yield (
        f"Cost: {costs.total:,} episodes ({costs.search:,} search, {costs.race:,} race,"
        f" {costs.comparison:,} comparison), {seconds:.1f} s."
    )
