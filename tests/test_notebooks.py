"""The notebooks under examples/ run from top to bottom, with nothing but the installed package."""

from __future__ import annotations

from pathlib import Path

import pytest

pytestmark = pytest.mark.process

NOTEBOOKS = sorted((Path(__file__).parents[1] / "examples").glob("*.ipynb"))


def test_there_are_two() -> None:
    """One analyses a sweep, one improves a tree."""
    assert [path.stem for path in NOTEBOOKS] == ["a_sweep", "a_tree"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the kernel's own libraries
def test_it_runs(path: Path, tmp_path: Path) -> None:
    """Every cell runs, in an empty folder, and each but the last Markdown has an output."""
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    NotebookClient(
        notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": tmp_path}}
    ).execute()
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert len(code) >= 4
    printed = [cell for cell in code if cell.outputs]
    assert len(printed) >= len(code) - 1
