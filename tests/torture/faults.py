"""The table of faults: what is done to a run, what happens, and the attempt that shows it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from tests.torture import clusters, damage, disks, stops, surroundings
from tests.torture.lab import Lab


@dataclass(frozen=True, slots=True)
class Fault:
    """A row of the table; `attempt` raises AssertionError where it is not so."""

    attempt: Callable[[Lab], None]
    happens: str
    lost: str = "nothing"


REFUSED: Final = "exit code 2, the reason in words; the same command continues the run"
FAULTS: Final = {
    "disk full": Fault(disks.full_disk, REFUSED),
    "disk full, with MLflow's store on it": Fault(
        disks.full_disk_tracked, f"the run ends without the store, or {REFUSED}"
    ),
    "file size limited (`ulimit -f`)": Fault(disks.file_limit, REFUSED),
    "folder read-only, before and during": Fault(disks.read_only_folder, REFUSED),
    "folder deleted, before and during": Fault(
        disks.deleted_folder,
        "exit code 2, the reason in words; the same command begins again",
        "what was in the folder",
    ),
    "open files limited (`ulimit -n`)": Fault(
        disks.open_files, "the run ends as usual, or exit code 2 with the reason in words"
    ),
    "memory limited (`ulimit -v`)": Fault(
        disks.memory, "the run ends as usual, or exit code 2 with the reason in words"
    ),
    "processes limited (`ulimit -u`)": Fault(
        disks.process_limit,
        "the run ends as usual, or exit code 2 with the reason in words;"
        " a child process may show a traceback",
    ),
    "INT, TERM, HUP": Fault(
        stops.stopping_signals, "exit code 130 and a line; the same command continues the run"
    ),
    "KILL, QUIT, USR1, USR2, ALRM": Fault(
        stops.ending_signals,
        "the process ends at once, its workers too; the same command continues the run",
    ),
    "PIPE, WINCH, TSTP, STOP and CONT": Fault(stops.harmless_signals, "the run goes on"),
    "everything killed at once": Fault(stops.lost_machine, "the same command continues the run"),
    "TERM at any moment, 20 times (Slurm's requeue)": Fault(
        stops.requeued, "exit code 130; the same command continues the run"
    ),
    "worker killed": Fault(stops.killed_workers, "it is replaced, its episodes run again"),
    "worker or simulator that does not answer": Fault(
        stops.silent_worker,
        "after `episode_timeout` exit code 2, with tree and world, and the action where it is the"
        " simulator; the same command continues the run",
    ),
    "the same command eight times at once, two sweeps": Fault(
        stops.two_commands, "one does the work, the others end with exit code 2"
    ),
    "clock set back and forth by years": Fault(surroundings.clock, "the run goes on"),
    "locale or encoding without characters": Fault(
        surroundings.encodings, "`?` in their place on the screen; the files are as always"
    ),
    "output closed, full, or read no more": Fault(
        surroundings.display, "the run goes on; a full standard output ends with exit code 2"
    ),
    "MLflow's server away, silent, slow, answering 500": Fault(
        surroundings.tracking_server,
        "no generation waits; exit code 0, and a line that names `islandgp sync`",
    ),
    "MLflow's database locked, damaged, empty, a folder": Fault(
        surroundings.database, "the run ends as usual and names `islandgp sync`, or exit code 2"
    ),
    "MLflow's server killed in mid-run": Fault(
        surroundings.dying_server, "exit code 0, and a line that names `islandgp sync`"
    ),
    "killed while records go to MLflow": Fault(
        surroundings.killed_between_run_and_store, "the same command sends each point once"
    ),
    "files of a finished run cut, changed, emptied, deleted": Fault(
        damage.finished_run,
        "exit code 2, the file's name",
    ),
    "files of an unfinished run cut, changed, emptied, deleted": Fault(
        damage.unfinished_run, "the run ends as usual, or exit code 2 with the reason in words"
    ),
    "Ray's workers killed": Fault(clusters.lost_workers, "Ray runs their episodes again"),
    "Ray's head or node killed": Fault(
        clusters.lost_head,
        "exit code 2 and a line within a minute; the same command continues the run",
    ),
}
