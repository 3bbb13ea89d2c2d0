"""`islandgp tune`: a tree with better numbers."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Final

import click

from islandgp.bt.language import parse, to_text
from islandgp.bt.numbers import Number, numbers_of, with_numbers
from islandgp.bt.printer import number_text
from islandgp.commands.files import FILE, OUTPUT, STDIN, called, folder_of, read_text, write_text
from islandgp.commands.setting import (
    Chosen,
    settings_of,
    stage_index,
    with_domain_options,
    with_stage_option,
)
from islandgp.errors import ConfigError, IslandError

if TYPE_CHECKING:
    from islandgp.config.settings import Settings
    from islandgp.evaluation.base import Evaluator
    from islandgp.running.tuning import RaceState

MOST: Final = 100  # numbers of a file that are tuned at a time


@click.command()
@click.argument("file", type=FILE)
@click.option("-o", "--output", type=OUTPUT, default=STDIN, help="File to write.")
@click.option(
    "--worlds",
    type=click.IntRange(2, 10_000),
    default=30,
    show_default=True,
    help="Worlds to tune in; as many others choose among the best, and as many tell what that is"
    " worth.",
)
@click.option(
    "--trials",
    type=click.IntRange(1, 10_000),
    default=50,
    show_default=True,
    help="Proposals of other numbers.",
)
@click.option("--seed", type=click.IntRange(0), default=0, help="Of worlds and proposals.")
@with_domain_options
@with_stage_option
def command(
    file: str,
    output: str,
    worlds: int,
    trials: int,
    seed: int,
    chosen: Chosen,
    stage: int | None,
) -> None:
    """Tune the numbers of the tree in FILE: thresholds and counts of repeaters.

    Everything else stays as it is written: names of constants, comments, subtrees. Numbers of
    included files stay, too. The tree is printed, or written with -o; what it is worth in
    worlds in which it was not tuned is told on the standard error. Ctrl-C keeps the best so far.
    """
    if find_spec("optuna") is None:
        raise ConfigError("Expected Optuna, found it not installed; pip install 'islandgp[optuna]'")
    from islandgp.evolution.validation import worlds_of
    from islandgp.running.run import make_evaluator
    from islandgp.running.tuning import choose
    from islandgp.seeding import Stream

    text, name, folder = read_text(file), called(file), folder_of(file)
    settings = settings_of(text, chosen, name=name)
    index = stage_index(settings, stage)
    ranges = _ranges(text, name, folder, settings)
    if not ranges:
        click.echo(f"{name}: there is no number to tune.", err=True)
        write_text(output, text)
        return
    tuning = worlds_of(seed, frozenset(), worlds, Stream.TUNING)
    choosing = worlds_of(seed, frozenset(tuning), worlds, Stream.VALIDATION)
    telling = worlds_of(seed, frozenset((*tuning, *choosing)), worlds, Stream.TEST)
    tree = _Tree(text, [number for number, _ in ranges], name, folder)
    allowed = [values for _, values in ranges]
    standing, stopped = _raced(tree, allowed, tuning, settings, index, trials, seed)
    best = standing.finalists[0]
    finalists = tuple(dict.fromkeys((tree.written, *standing.finalists)))
    try:
        with closing(make_evaluator(settings)) as evaluator:
            best = choose(tree.canonical, finalists, choosing, evaluator, index)
    except KeyboardInterrupt:
        stopped = True
    write_text(output, tree.text(best))
    _tell_race(standing, worlds, tree.numbers, best)
    if best != tree.written:
        with closing(make_evaluator(settings)) as evaluator:
            _tell_worth(tree, best, telling, evaluator, index)
    if stopped:
        raise click.Abort


def _ranges(
    text: str, name: str, folder: Path, settings: Settings
) -> list[tuple[Number, tuple[float, ...]]]:
    """The numbers of a tree that can be another one, each with the values that it may have.

    Raises:
        TreeError: the text is no tree of the domain.
        IslandError: there are more of them than MOST.
    """
    from islandgp.running.tuning import choices

    words = settings.problem().domain.schema.vocabulary
    parse(text, words, name=name, folder=folder)
    numbers = numbers_of(text, words, name=name, folder=folder)
    ranges = [(number, choices(number, words, settings.gp.trees.repeats)) for number in numbers]
    found = [(number, values) for number, values in ranges if len(values) > 1]
    if len(found) > MOST:
        raise IslandError(
            f"{name}: expected at most {MOST} numbers to tune, found {len(found)}; give those that"
            " belong together one name: constant NAME = NUMBER."
        )
    return found


class _Tree:
    """The tree of a file with any numbers."""

    def __init__(self, text: str, numbers: Sequence[Number], name: str, folder: Path) -> None:
        self.numbers = numbers
        self.written = tuple(number.value for number in numbers)
        self._text, self._name, self._folder = text, name, folder

    def text(self, values: Sequence[float]) -> str:
        """The file with these numbers."""
        return with_numbers(self._text, self.numbers, values)

    def canonical(self, values: Sequence[float]) -> str:
        """The whole tree, as jobs have it. Raises LimitError where it gets too long."""
        return to_text(parse(self.text(values), name=self._name, folder=self._folder))


def _raced(
    tree: _Tree,
    allowed: Sequence[Sequence[float]],
    worlds: Sequence[int],
    settings: Settings,
    stage: int,
    trials: int,
    seed: int,
) -> tuple[RaceState, bool]:
    """How the race ended, and whether it was stopped by Ctrl-C.

    Raises:
        KeyboardInterrupt: it was stopped before anything was known.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    from islandgp.running.run import make_evaluator
    from islandgp.running.tuning import race

    standing: RaceState | None = None
    console = Console(stderr=True)
    columns = (BarColumn(20), MofNCompleteColumn(), TextColumn("{task.description}"))
    progress = Progress(*columns, console=console, disable=not console.is_terminal, transient=True)
    try:
        with closing(make_evaluator(settings)) as evaluator, progress as bar:
            task = bar.add_task("trials", total=trials)
            for standing in race(
                tree.canonical,
                tree.written,
                allowed,
                worlds,
                evaluator,
                stage=stage,
                trials=trials,
                seed=seed,
            ):
                done = standing.trials - 1
                bar.update(task, completed=done, description=f"trials, {standing.gained:+,.6g}")
    except KeyboardInterrupt:
        if standing is None:
            raise
        return standing, True
    assert standing is not None
    return standing, False


def _tell_race(
    standing: RaceState, worlds: int, numbers: Sequence[Number], best: Sequence[float]
) -> None:
    """What was tried, and a line for each number."""
    click.echo(
        f"{standing.trials - 1} trials in {worlds} worlds: {standing.different - 1} different,"
        f" {standing.dropped} given up early, {standing.episodes} episodes.",
        err=True,
    )
    for number, value in zip(numbers, best, strict=True):
        became = "stays" if value == number.value else f"becomes {number_text(value)}"
        click.echo(
            f"  line {number.line}: {number.label} {number_text(number.value)} {became}", err=True
        )
    if all(value == number.value for number, value in zip(numbers, best, strict=True)):
        click.echo("Nothing better was found.", err=True)


def _tell_worth(
    tree: _Tree, best: Sequence[float], worlds: Sequence[int], evaluator: Evaluator, stage: int
) -> None:
    """The paired difference to the tree as it was, in worlds in which it was not tuned."""
    from islandgp.evaluation.base import Job
    from islandgp.evolution.validation import interval
    from islandgp.viewer.recording import digits

    texts = [tree.canonical(values) for values in (tree.written, best)]
    outcomes = evaluator.evaluate([Job(text, stage, world) for text in texts for world in worlds])
    before = [outcome.fitness for outcome in outcomes[: len(worlds)]]
    after = [outcome.fitness for outcome in outcomes[len(worlds) :]]
    differences = [b - a for a, b in zip(before, after, strict=True)]
    places = digits([*before, *after])
    found = interval(differences)
    mean, low, high = (f"{each:+,.{places}f}" for each in found)
    won = sum(difference > 0 for difference in differences)
    click.echo(
        f"In {len(worlds)} worlds that chose nothing: {fmean(after):,.{places}f} points, {mean} to"
        f" the tree as it was (95 %: {low} to {high}), better in {won}.",
        err=True,
    )
    if found[1] <= 0 <= found[2]:
        click.echo("That may be chance: the interval holds 0.", err=True)
