"""Whether a command waits at its end for what another process can do after it.

These are the last page of a run and the records that MLflow lacks.
"""

from __future__ import annotations

import os
from typing import Final, Literal

BATCH: Final = ("CI", "SLURM_JOB_ID", "PBS_JOBID", "LSB_JOBID")
"""Variables of environments that end all processes of a job when its last command ends."""


def command_waits(wait: Literal["auto", True, False]) -> bool:
    """True if a command waits at its end until all is written and sent.

    Args:
        wait: the setting. With "auto" it does not wait in a terminal, where somebody reads its
            output and types the next command. It waits if a process that it leaves behind could be
            ended: as the first process of a container or its child, in a job of a batch system or
            of continuous integration, and on Windows.
    """
    if wait != "auto":
        return wait
    in_terminal = os.isatty(0) and os.isatty(1)
    first = 1 in (os.getpid(), os.getppid())
    ends_with_command = os.name != "posix" or first or any(map(os.environ.get, BATCH))
    return ends_with_command or not in_terminal
