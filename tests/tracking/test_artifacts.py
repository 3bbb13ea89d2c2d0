"""The files that go with a run into MLflow."""

from __future__ import annotations

import json
import tracemalloc
from pathlib import Path

import pytest

from islandgp.gp.record import record_values
from islandgp.records.folder import Status
from islandgp.tracking.artifacts import TABLE, artifacts, table
from islandgp.viewer.run_page import NAME_OF_PAGE, run_page
from tests.tracking.folders import begun, closed_run, steps

GENERATIONS = 20
COMMENT = 10_000  # characters of each tree


def test_the_table_needs_no_individuals(tmp_path: Path) -> None:
    """The memory that it takes is a part of what the individuals of the run would take."""
    folder = begun(tmp_path / "run", tmp_path)
    record = json.dumps(record_values(steps()[0].record) | {"guidance": None})
    line = json.loads(record)
    for individual in line["individuals"]:
        individual["tree"] += "#" + COMMENT * "x"
    (folder.path / "generations.jsonl").write_text(GENERATIONS * (json.dumps(line) + "\n"))
    folder.close()
    tracemalloc.start()
    try:
        contents = {a.name: a.content for a in artifacts(folder)}
        text = contents[TABLE]()  # type: ignore[operator] # a text is made
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(json.loads(text)["data"]) == GENERATIONS
    assert peak < GENERATIONS * len(line["individuals"]) * COMMENT / 2


def test_the_table_is_that_of_whole_records(tmp_path: Path) -> None:
    """Nothing of a record is missing that it shows."""
    folder = closed_run(tmp_path / "run", tmp_path)
    contents = {a.name: a.content for a in artifacts(folder)}
    all_records = list(folder.records())
    assert contents[TABLE]() == json.dumps(table(all_records))  # type: ignore[operator] # a text is made


def test_the_replay_is_that_of_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its episode is not recorded again, unless the page has none."""
    folder = closed_run(tmp_path / "run", tmp_path)
    monkeypatch.setattr("islandgp.tracking.artifacts.champion_replay", lambda _: "new")

    def replay() -> str:
        text: str = {a.name: a.content for a in artifacts(folder)}["replay.html"]()  # type: ignore[operator]
        return text

    file = folder.path / NAME_OF_PAGE
    file.unlink(missing_ok=True)
    assert replay() == "new"
    for status, expected in ((Status.RUNNING, "new"), (Status.FINISHED, "<b>old</b>")):
        page = run_page(folder, status, replay="" if expected == "new" else expected)
        file.write_text(page, encoding="utf-8")
        assert replay() == expected
