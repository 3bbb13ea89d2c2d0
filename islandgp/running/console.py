"""Standard streams and signals of a command.

The standard output has results, so a failed write is an error. The error stream has messages about
progress, so a failed write is ignored. Signals end a command as Ctrl-C does.
"""

from __future__ import annotations

import errno
import io
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any, Final, TextIO

from islandgp.errors import IslandError, PartError, in_the_way
from islandgp.gate import cleaned
from islandgp.records.parameters import without_credentials
from islandgp.startup import stop_at_once

FULL: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO})

SHORTAGE: Final = frozenset({errno.EAGAIN, errno.EMFILE, errno.ENFILE, errno.ENOMEM})
SHORTAGE_WORDS: Final = ("start new thread", "failed to map segment", "allocate memory")
"""Error numbers and words of messages for a lack of memory, processes or open files."""

RETRY_S: Final = 0.05  # seconds after which a lost signal is raised again


@contextmanager
def checked_stdout() -> Iterator[None]:
    """Context that flushes the standard output; `?` replaces characters that it cannot encode.

    Raises:
        IslandError: the output cannot be written, e.g. because the disk is full.
        SystemExit: the reader of the output has ended, e.g. `| head`.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")
    try:
        try:
            yield
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()
    except BrokenPipeError:
        _drop(sys.stdout)
        sys.exit(1)
    except OSError as error:
        if error.filename is not None or error.errno not in FULL:
            raise
        _drop(sys.stdout)
        raise IslandError(
            f"Expected to write to the standard output, found: {error.strerror}; make room, or"
            " send it elsewhere."
        ) from None


def _drop(stream: TextIO) -> None:
    """Drops unwritten and further output, also what the interpreter would write at its exit."""
    with suppress(OSError, ValueError):  # a stream without a file
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def echo(text: str) -> None:
    """Prints text that is also stored elsewhere; an output without a reader is no error."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        _drop(sys.stdout)


class Display:
    """An error stream that never fails: text that cannot be written is dropped."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write text, or drop it if the stream is broken; returns len(text)."""
        self._try(self._stream.write, text)
        return len(text)

    def flush(self) -> None:
        """Flush the stream, or drop the text if it is broken."""
        self._try(self._stream.flush)

    def _try(self, action: Callable[..., object], *arguments: str) -> None:
        try:
            action(*arguments)
        except (OSError, ValueError):  # ValueError: it is closed
            _drop(self._stream)

    def __getattr__(self, name: str) -> Any:
        """Any other attribute is that of the stream."""
        return getattr(self._stream, name)


@contextmanager
def tolerant_stderr() -> Iterator[None]:
    """Context in which the error stream is a `Display`, also if there was no error stream."""
    for number in range(3):  # else other files could get the numbers of closed streams
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    before = sys.stderr
    with Path(os.devnull).open("w", encoding="utf-8") as nowhere:
        display: Any = Display(before or nowhere)
        sys.stderr = display
        try:
            yield
        finally:
            display.flush()
            if sys.stderr is display:  # it may have been replaced
                sys.stderr = before


@contextmanager
def as_ctrl_c(*names: str) -> Iterator[None]:
    """Context in which these signals raise KeyboardInterrupt, as SIGINT does.

    Ignored signals stay ignored, as under `nohup`; signals that the system does not have are
    skipped. After a signal any error is replaced by KeyboardInterrupt, because interrupted
    libraries may raise errors of their own. A signal during a finalizer, where Python drops
    exceptions, is raised again after RETRY_S seconds.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    interrupt: KeyboardInterrupt | None = None
    old_hook = sys.unraisablehook

    def stop(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 -- a handler's
        nonlocal interrupt
        interrupt = KeyboardInterrupt(number)
        raise interrupt

    def lost(unraisable: sys.UnraisableHookArgs) -> None:
        if interrupt is None or unraisable.exc_value is not interrupt:
            old_hook(unraisable)
            return
        timer = threading.Timer(RETRY_S, signal.raise_signal, interrupt.args)
        timer.daemon = True
        timer.start()

    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    old = {n: signal.getsignal(n) for n in numbers if signal.getsignal(n) is not signal.SIG_IGN}
    if signal.getsignal(signal.SIGINT) in (signal.default_int_handler, stop_at_once):
        old[signal.SIGINT] = signal.getsignal(signal.SIGINT)
    for number in old:
        signal.signal(number, stop)
    sys.unraisablehook = lost
    try:
        yield
    except Exception as error:
        if interrupt is not None:
            raise KeyboardInterrupt from error
        raise
    finally:
        sys.unraisablehook = old_hook
        for number, handler in old.items():
            signal.signal(number, handler)


def exit_code(work: Callable[[], int], stopped: str = "stopped") -> int:
    """The result of a command's work, or the code of its error, which is printed.

    Args:
        work: of the command.
        stopped: what is said after Ctrl-C.

    Returns:
        1: a bug; 2: an error of the user; 130: Ctrl-C; else what `work` returns.
    """
    with tolerant_stderr():
        try:
            with checked_stdout():
                return work()
        except IslandError as error:
            if isinstance(error, PartError):
                traceback.print_exception(error.__cause__)
            code, message = 2, without_credentials(str(error))
        except KeyboardInterrupt:
            code, message = 130, stopped
        except Exception as error:
            code, message = 2, shortage(error)
            if not message and isinstance(error, ImportError | AttributeError):
                message = in_the_way(Path.cwd())
            if not message:
                traceback.print_exc()
                code, message = 1, "this is a bug in islandgp; the records of runs are kept"
        print(cleaned(f"islandgp: {message}"), file=sys.stderr)
        return code


def shortage(error: BaseException) -> str:
    """The message if an error, or one of its causes, is a lack of resources; else an empty text."""
    cause: BaseException | None = error
    while cause is not None:
        has_words = any(words in str(cause).lower() for words in SHORTAGE_WORDS)
        if isinstance(cause, MemoryError) or has_words or getattr(cause, "errno", 0) in SHORTAGE:
            return (
                "Expected enough memory, processes and open files for the run, found:"
                f" {str(cause) or 'no more memory'}; raise the limit that is too low"
                " (ulimit -a shows them), or set fewer evaluator.policy.workers, and repeat the"
                " command."
            )
        cause = cause.__cause__ or cause.__context__
    return ""
