"""Faults of a Ray cluster."""

from __future__ import annotations

import os
import signal
from importlib.util import find_spec

from tests.running.commands import processes
from tests.torture.lab import BASE, Lab, Missing, assert_refused, start, under_way

RAY = (
    *BASE,
    "world.episode.length=20",
    "gp.generations=40",
    "evaluator=ray",
    "evaluator.policy.address=local",
    "evaluator.policy.workers=2",
)


def lost_workers(lab: Lab) -> None:
    """Ray's workers killed now and then; the run itself goes on."""
    if find_spec("ray") is None:
        raise Missing("Ray is not installed")
    home = lab.folder()
    process = start(home, *RAY)
    for n in range(4):
        under_way(home, process, 3 + 10 * n)
        for number, (_, line) in processes(process.pid).items():
            if line.startswith(("ray::_run", "ray::IDLE")):
                os.kill(number, signal.SIGKILL)
    ending = lab.end(process)
    assert ending.code == 0, ending
    assert "Traceback" not in ending.output, ending.output
    lab.assert_same(home, RAY)


def lost_head(lab: Lab) -> None:
    """The head of the cluster killed in the middle of a run: one message, in bounded time."""
    if find_spec("ray") is None:
        raise Missing("Ray is not installed")
    arguments = (*RAY, "gp.generations=1200")  # more than are made until Ray notices: a minute
    for part in ("gcs_server", "raylet/raylet"):
        home = lab.folder()
        process = start(home, *arguments)
        under_way(home, process)
        for number, (_, line) in processes(process.pid).items():
            if part in line:
                os.kill(number, signal.SIGKILL)
        assert_refused(lab.end(process), "Ray cluster", "has ended")
    lab.assert_finishes(home, arguments)
