"""Faults of processes: signals, workers that die or do not answer, two commands at once."""

from __future__ import annotations

import os
import random
import signal
from time import sleep

from tests.running.commands import workers
from tests.torture.lab import (
    REAL,
    SLOW,
    Lab,
    assert_refused,
    communicate,
    recorded_generations,
    start,
    under_way,
)

STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # what a command makes a clean stop of
ENDING = (signal.SIGKILL, signal.SIGQUIT, signal.SIGUSR1, signal.SIGUSR2, signal.SIGALRM)
LONG = (*REAL, "gp.generations=60")


def stopping_signals(lab: Lab) -> None:
    """INT, TERM and HUP in a run of one process and in one with workers."""
    for arguments in (SLOW, LONG):
        for number in STOPPING:
            home = lab.folder()
            process = start(home, *arguments)
            under_way(home, process)
            process.send_signal(number)
            ending = lab.end(process)
            assert ending.code == 130, (number, ending)
            assert "stopped; the same command continues the run" in ending.output
            assert "Traceback" not in ending.output, ending.output
            lab.assert_finishes(home, arguments)


def ending_signals(lab: Lab) -> None:
    """Signals that end a process at once, without a message."""
    for arguments in (SLOW, LONG):
        for number in ENDING:
            home = lab.folder()
            process = start(home, *arguments)
            under_way(home, process)
            process.send_signal(number)
            assert lab.end(process).code == -number
            lab.assert_finishes(home, arguments)


def harmless_signals(lab: Lab) -> None:
    """PIPE; TSTP and CONT, as Ctrl-Z and `fg`; WINCH, as a window that changes its size."""
    for arguments in (SLOW, LONG):
        home = lab.folder()
        process = start(home, *arguments)
        under_way(home, process)
        for number in (signal.SIGPIPE, signal.SIGWINCH, signal.SIGTSTP):
            os.killpg(process.pid, number)
            sleep(0.3)
        os.killpg(process.pid, signal.SIGSTOP)  # TSTP alone is ignored where no shell is there
        sleep(1)
        os.killpg(process.pid, signal.SIGCONT)
        ending = lab.end(process)
        assert ending.code == 0, ending
        lab.assert_same(home, arguments)


def requeued(lab: Lab) -> None:
    """TERM at any moment, from the first import on, and the same command again, as by Slurm."""
    moments = random.Random(18)
    home = lab.folder()
    for _ in range(20):
        process = start(home, *LONG)
        sleep(moments.uniform(0.05, 2.5))
        process.terminate()
        ending = lab.end(process)
        # Before the interpreter has come to our code, the signal simply ends it.
        assert ending.code in (0, 130) or (ending.code, ending.output) == (-signal.SIGTERM, ""), (
            ending
        )
        assert "Traceback" not in ending.output, ending.output
    lab.assert_finishes(home, LONG)


def killed_workers(lab: Lab) -> None:
    """A worker killed now and then; the run itself goes on."""
    moments = random.Random(4)
    home = lab.folder()
    process = start(home, *LONG)
    under_way(home, process)
    kills = 0
    while kills < 8:
        if running := workers(process):
            os.kill(moments.choice(running), signal.SIGKILL)
            kills += 1
            under_way(home, process, 3 + 5 * kills)
    ending = lab.end(process)
    assert ending.code == 0, ending
    lab.cases += kills - 1
    assert "Traceback" not in ending.output, ending.output
    lab.assert_same(home, LONG)


def silent_worker(lab: Lab) -> None:
    """A stopped worker, and a simulator that hangs: one message after the time limit."""
    home = lab.folder()
    arguments = (*LONG, "evaluator.policy.episode_timeout=2")
    process = start(home, *arguments)
    under_way(home, process)
    os.kill(max(workers(process)), signal.SIGSTOP)
    assert_refused(lab.end(process), "no answer of its worker in 2 s", "episode_timeout")
    lab.assert_finishes(home, arguments)

    home = lab.folder()
    flag = home / "hang"
    hanging = (
        *arguments,
        "domain.factory=tests.torture.hanging:HangingIsland",
        "gp.generations=40",
    )
    os.environ["ISLAND_HANGS"] = str(flag)
    process = start(home, *hanging)
    under_way(home, process)
    flag.touch()
    assert_refused(lab.end(process), "still running after 2 s", "world seed")
    flag.unlink()
    lab.assert_finishes(home, hanging)


def two_commands(lab: Lab) -> None:
    """The same command eight times at once, and two sweeps over the same runs."""
    home = lab.folder()
    all_of_them = [start(home, *SLOW) for _ in range(8)]
    ends = [lab.end(process) for process in all_of_them]
    assert {ending.code for ending in ends} == {0, 2}, ends
    for ending in ends:
        assert "Traceback" not in ending.output, ending.output
        if ending.code:
            assert_refused(ending, "found another run at work")
    lab.assert_same(home, SLOW)

    home = lab.folder()
    sweep = (*SLOW, "seed=0,1,2", "-m")
    first = start(home, *sweep)
    under_way(home, first)
    assert_refused(lab.run(home, *sweep), "another")
    code, output = communicate(first)
    assert code == 0, output
    lab.assert_same(home, sweep)


def lost_machine(lab: Lab) -> None:
    """`kill -9` of everything at once, ten times, as a machine that loses its power."""
    moments = random.Random(9)
    home = lab.folder()
    for n in range(10):
        process = start(home, *LONG)
        if n % 2:
            sleep(moments.uniform(0.1, 2))
        else:
            under_way(home, process, recorded_generations(home) + 1)
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        lab.cases += 1
    lab.assert_finishes(home, LONG)
