"""The notebooks under examples/ run from top to bottom, with nothing but the installed package."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

pytestmark = [
    pytest.mark.process,
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),  # of the kernel's own libraries
]

NOTEBOOKS = {path.stem: path for path in (Path(__file__).parents[1] / "examples").glob("*.ipynb")}
SMALL = '"tracking=off", "gp.population=6", "gp.generations=3"'


def executed(notebook: Any, folder: Path) -> Any:
    """The notebook with the outputs of a run in an empty folder."""
    from nbclient import NotebookClient

    resources = {"metadata": {"path": folder}}
    return NotebookClient(
        notebook, timeout=3000, kernel_name="python3", resources=resources
    ).execute()


def printed_outputs(notebook: Any) -> list[str]:
    """The texts of the outputs, without those of figures."""
    texts = [
        output["text"] if output.output_type == "stream" else output["data"].get("text/plain", "")
        for cell in notebook.cells
        for output in cell.get("outputs", [])
    ]
    return [text for text in texts if "Figure" not in text]


def test_there_are_two_notebooks() -> None:
    """One analyses a sweep, one improves a tree."""
    assert sorted(NOTEBOOKS) == ["a_sweep", "a_tree"]


@pytest.mark.slow
@pytest.mark.parametrize("name", NOTEBOOKS)
def test_it_runs(name: str, tmp_path: Path) -> None:
    """Every cell runs, with smaller experiments, and has outputs where those in the file are."""
    import nbformat

    saved = nbformat.read(NOTEBOOKS[name], as_version=4)
    notebook = nbformat.read(NOTEBOOKS[name], as_version=4)
    for cell in notebook.cells:
        cell["source"] = cell["source"].replace('"tracking=off"', SMALL)
    assert len(printed_outputs(executed(notebook, tmp_path))) == len(printed_outputs(saved)) > 0


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", NOTEBOOKS)
def test_its_outputs_are_up_to_date(name: str, tmp_path: Path) -> None:
    """The file has the outputs of its own cells, to the digit."""
    import nbformat

    saved = nbformat.read(NOTEBOOKS[name], as_version=4)
    notebook = nbformat.read(NOTEBOOKS[name], as_version=4)
    assert printed_outputs(executed(notebook, tmp_path)) == printed_outputs(saved)
