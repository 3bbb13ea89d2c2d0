"""`islandgp play`: a tree on the island, in many worlds or in one to watch."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from statistics import fmean, stdev
from typing import TYPE_CHECKING, Any, Final

import click

from islandgp.bt.language import to_text
from islandgp.bt.node import Node
from islandgp.commands.files import FILE, read_tree
from islandgp.commands.setting import configured, stage_index, with_island_options
from islandgp.settings import Settings

if TYPE_CHECKING:
    from rich.table import Table

    from islandgp.scoring.outcome import Outcome

_COUNTS: Final = {
    "pickups": "picked up",
    "interactions": "humanoids",
    "deliveries": "delivered",
    "charges": "charged",
    "collisions": "collided",
    "laps": "laps",
}
"""Fields of an outcome, and what the table calls them."""


@click.command()
@click.argument("file", type=FILE)
@click.option(
    "--seeds", type=click.IntRange(1, 100_000), default=30, show_default=True, help="Worlds."
)
@click.option("--watch", is_flag=True, help="Follow one episode in the terminal.")
@click.option("--seed", type=click.IntRange(0), default=0, help="World of --watch; default: 0.")
@click.option(
    "--speed", type=click.FloatRange(0), default=10.0, help="Of --watch; 0: without waiting."
)
@click.option("--json", "as_json", is_flag=True, help="Print the outcomes as JSON.")
@with_island_options
def command(
    file: str,
    seeds: int,
    watch: bool,
    seed: int,
    speed: float,
    as_json: bool,
    overrides: tuple[str, ...],
    config_dir: str | None,
    stage: int | None,
) -> None:
    """Run the tree in FILE in the worlds 0, 1, 2, ...

    Tells what it achieved in each, its quality tiers (Table 4), and where its
    fitness came from. Worlds of evolution have other seeds.
    """
    tree = read_tree(file)
    settings = configured(overrides, config_dir)
    index = stage_index(settings, stage)
    if watch:
        from islandgp.viewer.recording import record
        from islandgp.viewer.watch import watch as show

        recording = record(tree, settings, seed=seed, stage=index)
        show(recording, speed=speed or 10.0, pause=time.sleep if speed else lambda _: None)
        return
    outcomes = _outcomes(tree, settings, seeds, index)
    if as_json:
        click.echo(json.dumps([asdict(outcome) for outcome in outcomes], indent=2))
        return
    _print(outcomes, settings, index)


def _outcomes(tree: Node, settings: Settings, seeds: int, stage: int) -> list[Outcome]:
    """The outcomes in the worlds 0 to seeds - 1, with a progress bar where there is a terminal."""
    from rich.console import Console
    from rich.progress import Progress

    from islandgp.evaluation.base import Job
    from islandgp.run import make_evaluator

    jobs = [Job(to_text(tree), stage, seed) for seed in range(seeds)]
    if seeds < 4:  # quicker than starting processes
        serial = settings.evaluator.model_validate(
            {"factory": "islandgp.evaluation.serial:Serial", "cache": False, "policy": {}}
        )
        settings = settings.model_copy(update={"evaluator": serial})
    evaluator = make_evaluator(settings)
    outcomes: list[Outcome] = []
    console = Console(stderr=True)
    try:
        with Progress(console=console, disable=not console.is_terminal, transient=True) as bar:
            task = bar.add_task("episodes", total=seeds)
            for start in range(0, seeds, 16):
                outcomes += evaluator.evaluate(jobs[start : start + 16])
                bar.update(task, completed=len(outcomes))
    finally:
        evaluator.close()
    return outcomes


def _print(outcomes: Sequence[Outcome], settings: Settings, stage: int) -> None:
    from rich.console import Console

    from islandgp.scoring.classify import Tier, tiers

    # Where the output is a file or a pipe, lines are as long as they must be.
    console = Console(highlight=False, width=None if sys.stdout.isatty() else 140)
    console.print(_worlds(outcomes, settings))
    console.print(_means(outcomes, stage))
    reached = [tiers(outcome, settings.classes) for outcome in outcomes]
    counts = [f"{tier.value} {sum(tier in r for r in reached)}" for tier in Tier]
    console.print(f"Tiers, of {len(outcomes)} worlds: {', '.join(counts)}")


def _worlds(outcomes: Sequence[Outcome], settings: Settings) -> Table:
    from rich.table import Table

    from islandgp.scoring.classify import specialist, tiers

    table = Table(box=None, padding=(0, 1), header_style="bold")
    for column in ("world", "fitness", *_COUNTS.values(), "battery", "seconds"):
        table.add_column(column, justify="right", no_wrap=True)
    for column in ("ended by", "class", "best tier"):
        table.add_column(column, no_wrap=True)
    for seed, o in enumerate(outcomes):
        reached = tiers(o, settings.classes)
        table.add_row(
            str(seed),
            f"{o.fitness:,.0f}",
            *(f"{getattr(o, name):.0f}" for name in _COUNTS),
            f"{o.battery:.0f} %",
            f"{o.seconds:.0f}",
            o.endings[0],
            specialist(o, settings.classes).value,
            reached[0].value if reached else "",
        )
    return table


def _means(outcomes: Sequence[Outcome], stage: int) -> Table:
    from rich.table import Table

    from islandgp.scoring.rewards import Component

    table = Table(
        title=f"Fitness by component, stage {stage + 1}",
        title_justify="left",
        box=None,
        padding=(0, 1),
        header_style="bold",
    )
    table.add_column("")
    for column in ("mean", "sd", "least", "most"):
        table.add_column(column, justify="right")
    rows: list[tuple[str, list[float]]] = [
        (component.name.lower(), [o.components[component] for o in outcomes])
        for component in Component
    ]
    rows.append(("fitness", [o.fitness for o in outcomes]))
    for name, values in rows:
        told: list[Any] = [fmean(values), stdev(values) if len(values) > 1 else 0.0]
        told += [min(values), max(values)]
        table.add_row(name, *(f"{value:,.0f}" for value in told))
    return table
