"""The evolution of the default experiment's first generations, on 1, 2 and 4 workers."""

from __future__ import annotations

from statistics import median
from time import perf_counter
from typing import Final, NamedTuple

from benchmarks.figure import Effort, Figure, at_least
from benchmarks.pinned import SEED, STAGE, example, settings
from islandgp.bt.core.language import to_text
from islandgp.config.settings import Settings
from islandgp.evaluation.base import Job, Problem
from islandgp.evaluation.processes import Processes, cores
from islandgp.evolution.loop import evolve
from islandgp.running.parts import make_supervisor

WORKERS: Final = (1, 2, 4)
ROUNDS: Final = {Effort.TINY: 1, Effort.QUICK: 1, Effort.FULL: 2}
SHORTER: Final = {
    Effort.TINY: ("gp.population=6", "gp.generations=2", "world.episode.length=5"),
    Effort.QUICK: ("gp.generations=11",),
    Effort.FULL: ("gp.generations=11",),
}
WARM_UP: Final = 8  # episodes for each worker, so that every one has started and imported


class Evolution(NamedTuple):
    """What one evolution took."""

    start: float  # s until the workers had started
    evolving: float  # s from the first generation to the last
    evaluating: float  # s of it in which episodes ran


def measure(effort: Effort) -> list[Figure]:
    """Evolutions in turns: 1, 2, 4 workers, and again."""
    chosen = settings("search=paper", *SHORTER[effort])
    counts = [n for n in WORKERS if n <= cores()]
    evolutions: dict[int, list[Evolution]] = {n: [] for n in counts}
    for _ in range(ROUNDS[effort]):
        for n in counts:
            evolutions[n].append(_evolve(chosen, n))
    seconds = {n: median(e.start + e.evolving for e in runs) for n, runs in evolutions.items()}
    evolving = {n: median(e.evolving for e in runs) for n, runs in evolutions.items()}
    most = counts[-1]
    size = f"{chosen.gp.generations} generations of {chosen.gp.population}"
    figures = [
        Figure(
            f"run_s_{n}",
            seconds[n],
            "s",
            f"{size}, {n} worker{'s' * (n > 1)}, with their start",
        )
        for n in counts
    ]
    for n in counts[1:]:
        speed_up = evolving[1] / evolving[n]
        figures += [
            Figure(f"speed_up_{n}", speed_up, "", f"{n} workers over 1, workers started"),
            Figure(
                f"efficiency_{n}",
                100 * speed_up / n,
                "%",
                f"speed-up over {n} workers",
                at_least(90.0),
            ),
        ]
    serial = median(e.evolving - e.evaluating for e in evolutions[most])
    return [
        *figures,
        Figure(
            "start_s",
            median(e.start for e in evolutions[most]),
            "s",
            f"start of {most} workers, and {WARM_UP} episodes each",
        ),
        Figure("serial_s", serial, "s", "operators and supervisor, which one core does"),
    ]


def _evolve(chosen: Settings, workers: int) -> Evolution:
    domain = chosen.make_domain()
    setting = Problem(domain, chosen.curriculum)
    supervisor = make_supervisor(chosen, None)
    tree = to_text(example("all_rounder"))
    began = perf_counter()
    processes = Processes(setting, workers)
    try:
        processes.evaluate([Job(tree, STAGE, seed) for seed in range(WARM_UP * workers)])
        started = perf_counter()
        costs = [s.cost for s in evolve(chosen.plan(domain), SEED, supervisor, processes)]
        ended = perf_counter()
    finally:
        processes.close()
    return Evolution(
        start=started - began,
        evolving=ended - started,
        evaluating=sum(cost.evaluation for cost in costs),
    )
