"""Each benchmark runs in a tiny form and gives its figures; no time is asserted."""

from __future__ import annotations

from importlib import import_module
from typing import Final

import pytest

from benchmarks.__main__ import BENCHMARKS
from benchmarks.figure import Effort, Figure
from islandgp.evaluation.processes import cores

FIGURES: Final = {
    "engine_ratio": "engine_ratio engine_ratio_of_medians episode_ms bare_ms",
    "peer_ratio": "peer_ratio peer_batch_s our_batch_s single_ratio peer_episode_ms"
    " our_episode_ms peer_pickups peer_deliveries",
    "tick_us": "tick_us tick_us_py_trees tick_ratio_py_trees tick_us_behaviortreepy"
    " tick_ratio_behaviortreepy walk_us walk_us_py_trees walk_ratio_py_trees"
    " walk_us_behaviortreepy walk_ratio_behaviortreepy",
    "run_s": "run_s_1 run_s_2 run_s_4 speed_up_2 efficiency_2 speed_up_4 efficiency_4"
    " start_s serial_s",
    "remote_overhead": "remote_overhead remote_episode_ms local_episode_ms",
    "overhead_share": "overhead_share_off overhead_share_mlflow mlflow_share episodes_s operators_s"
    " supervision_s rest_s run_s_off run_s_mlflow new_store_s command_s_off"
    " command_s_mlflow paper_ratio",
    "startup_s": "help_s config_error_s first_generation_s worker_mb worker_own_mb",
    "growth": "per_garbage_us per_garbage_power per_humanoid_us per_humanoid_power"
    " per_node_us per_node_power per_individual_us per_individual_power",
    "profile_share": "all_rounder_motion all_rounder_tree all_rounder_account all_rounder_rest"
    " all_rounder_samples random_motion random_tree random_account random_rest random_samples",
    "worlds_ratio": "cartpole_ratio cartpole_step_us cartpole_bare_us lunarlander_ratio"
    " lunarlander_step_us lunarlander_bare_us",
}
GOALS: Final = {  # of the figures that have one at any effort
    "engine_ratio": 1.2,
    "peer_ratio": 35.0,
    "tick_us": 2.0,
    "walk_us": 2.0,
    "efficiency_2": 90.0,
    "efficiency_4": 90.0,
    "remote_overhead": 20.0,
    "cartpole_ratio": 1.5,
    "lunarlander_ratio": 1.2,
}


QUICK: Final = ("engine_ratio", "tick_us")  # they start no process
LIBRARIES: Final = {
    "peer_ratio": ("deap", "py_trees"),
    "remote_overhead": ("ray",),
    "tick_us": ("behaviortreepy",),
    "worlds_ratio": ("gymnasium",),
}


def needed(benchmark: str) -> None:
    """Skips where an extra is not installed."""
    for library in LIBRARIES.get(benchmark, ()):
        pytest.importorskip(library, reason="an extra is not installed")


def expected(benchmark: str) -> list[str]:
    """Its figures; workers that this machine has no cores for are left out."""
    names = FIGURES[benchmark].split()
    if benchmark != "run_s":
        return names
    too_many = tuple(f"_{n}" for n in (2, 4) if n > cores())
    return [name for name in names if not name.endswith(too_many)] if too_many else names


@pytest.mark.parametrize(
    "benchmark",
    [
        pytest.param(name, marks=() if name in QUICK else (pytest.mark.process, pytest.mark.slow))
        for name in BENCHMARKS
    ],
)
def test_a_benchmark_gives_its_figures(benchmark: str) -> None:
    """All figures by name, with the goals of the issue they come from, and no other goals."""
    needed(benchmark)
    figures: list[Figure] = import_module(f"benchmarks.{benchmark}").measure(Effort.TINY)
    assert [figure.name for figure in figures] == expected(benchmark)
    for figure in figures:
        assert figure.what
        assert (figure.goal.value if figure.goal else None) == GOALS.get(figure.name)


def test_names_are_unique() -> None:
    """A figure's name alone identifies it."""
    names = " ".join(FIGURES.values()).split()
    assert len(set(names)) == len(names)
    assert set(FIGURES) == set(BENCHMARKS)
