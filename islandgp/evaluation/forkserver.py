"""Starts the server from which the workers of `processes` are forked; imports only fast modules."""

from __future__ import annotations

import multiprocessing
import os
import re
import signal
from collections.abc import Sequence
from typing import Final

OTHER_WORKERS: Final = re.compile(r"-(?!-config-dir\b)|[+~]*(domain|evaluator|experiment|hydra)\b")
"""Options and overrides with which a command may have another domain, another evaluator or no run,
or many runs."""


def start_for_command(arguments: Sequence[str]) -> None:
    """Starts the server for a command of one run in the default domain; does nothing for others.

    It imports what workers need while this process does the same and composes the configuration.

    Args:
        arguments: of the command.
    """
    if not any(map(OTHER_WORKERS.match, arguments)):
        from islandgp.domain_files import default_domain_module  # only for these commands

        start_forkserver(default_domain_module())


def set_imports(domain: str) -> None:
    """Sets the modules that a forkserver imports when it starts: those that its workers need."""
    if os.name == "posix":
        modules = ["islandgp.evaluation.forked", "islandgp.evaluation.processes", domain]
        multiprocessing.get_context("forkserver").set_forkserver_preload(modules)


def start_forkserver(domain: str) -> None:
    """Starts the process that forks workers, if it does not run yet.

    `Processes` starts it as well, and waits for its imports. A process that has other work to do
    first saves this time by an earlier start.

    Args:
        domain: module of the domain. Workers import another one by themselves.
    """
    if os.name == "posix":
        from multiprocessing import forkserver, resource_tracker  # which other systems lack

        set_imports(domain)
        # This process handles Ctrl-C. The server inherits the blocked signal; otherwise it
        # would print a traceback during its imports. A resource tracker unblocks it when it starts.
        resource_tracker.ensure_running()
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            forkserver.ensure_running()
        except OSError:
            pass  # `Processes` reports it
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
