"""When a command waits at its end for what another process can do."""

from __future__ import annotations

import os
from typing import Any

import pytest

from islandgp import waiting
from islandgp.waiting import command_waits


@pytest.mark.parametrize(
    ("wait", "terminals", "ids", "variables", "waits"),
    [
        pytest.param("auto", (0, 1, 2), (7, 6), {}, False, id="terminal"),
        pytest.param("auto", (0, 1), (7, 6), {}, False, id="errors-in-a-file"),
        pytest.param("auto", (0, 2), (7, 6), {}, True, id="output-in-a-pipe"),
        pytest.param("auto", (1, 2), (7, 6), {}, True, id="no-input"),
        pytest.param("auto", (0, 1, 2), (1, 0), {}, True, id="container"),
        pytest.param("auto", (0, 1, 2), (7, 1), {}, True, id="container-with-init"),
        pytest.param("auto", (0, 1, 2), (7, 6), {"SLURM_JOB_ID": "3"}, True, id="batch-job"),
        pytest.param(True, (0, 1, 2), (7, 6), {}, True, id="true"),
        pytest.param(False, (), (1, 0), {"CI": "true"}, False, id="false"),
    ],
)
@pytest.mark.skipif(os.name != "posix", reason="a command on Windows always waits")
def test_a_command_waits_unless_it_runs_in_a_terminal(
    wait: Any,
    terminals: tuple[int, ...],
    ids: tuple[int, int],
    variables: dict[str, str],
    waits: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A setting of true or false applies everywhere. `ids`: of the process and its parent."""
    for name in waiting.BATCH:
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(os, "isatty", lambda fd: fd in terminals)
    monkeypatch.setattr(os, "getpid", lambda: ids[0])
    monkeypatch.setattr(os, "getppid", lambda: ids[1])
    assert command_waits(wait) is waits
