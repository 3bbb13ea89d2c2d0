"""The thread that sends records to MLflow: one for all runs of a process.

It is a daemon thread, so a server that does not answer cannot keep the process alive. The records
are in the runs' folders; `islandgp sync` sends what the thread has not sent.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from concurrent.futures import Future, wait
from functools import cache
from queue import Queue
from threading import Thread
from time import monotonic, sleep
from typing import Final

from islandgp.errors import brief
from islandgp.tracking.store import load

MESSAGE_DELAY: Final = 2.0  # s of waiting before the user gets a message
RETRY_DELAY: Final = 1.0  # s before a failed task is repeated

Task = Callable[[], str]
"""Sends records; returns "" or why some of them were not sent. It raises if the store fails."""


class Sender:
    """Executes tasks one after the other in a daemon thread."""

    def __init__(self) -> None:
        self._tasks: Queue[tuple[Task, Future[str]]] = Queue()
        self._progress = monotonic()  # time of the last answer of a store
        Thread(target=self._work, name="mlflow", daemon=True).start()
        self._loaded = self.put(load)

    def put(self, task: Task) -> Future[str]:
        """Queue a task; return immediately."""
        future: Future[str] = Future()
        self._tasks.put((task, future))
        return future

    def alive(self) -> None:
        """A store has answered; tasks call this after each batch of records."""
        self._progress = monotonic()

    def _work(self) -> None:
        while True:
            task, future = self._tasks.get()
            try:
                future.set_result(task())
                self.alive()
            except Exception as error:  # a store may fail in any way, and a folder be damaged
                future.set_exception(error)

    def finish(self, task: Task, patience: float, command: str, *, may_hang: bool) -> str:
        """Execute a task and wait for it; repeat it while it fails. Ctrl-C ends the waiting.

        Args:
            task: to execute.
            patience: s without an answer after which it gives up, >= 0; with 0 it does not wait.
            command: that sends the rest, for the message after MESSAGE_DELAY.
            may_hang: True: the store is a server, which may never answer. For a file, the patience
                counts from its first failure.

        Returns:
            "", or the reason why not everything was sent.
        """
        begin, reason, is_informed = monotonic(), "", False
        future = self.put(task)
        try:
            while True:
                wait([future], min(patience, MESSAGE_DELAY / 4))
                if future.done():
                    try:
                        return future.result()
                    except Exception as error:
                        reason = brief(error)
                    sleep(min(patience, RETRY_DELAY))
                    future = self.put(task)
                if not self._loaded.done() or not (may_hang or reason):
                    self.alive()  # imports and a new SQLite file take long on a busy machine
                if monotonic() - max(begin, self._progress) >= patience:
                    return reason or f"no answer in {patience:g} s"
                if not is_informed and monotonic() - begin >= MESSAGE_DELAY:
                    is_informed = True
                    message = f"sending to MLflow; Ctrl-C stops waiting, `{command}` sends the rest"
                    print(message, file=sys.stderr, flush=True)
        except KeyboardInterrupt:
            return "waiting was interrupted"


@cache
def sender() -> Sender:
    """The sender of this process, started when it is first needed."""
    return Sender()
