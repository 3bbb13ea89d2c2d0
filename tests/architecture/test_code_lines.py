"""What counts as a line of code."""

from __future__ import annotations

import pytest

from tests.architecture.code_lines import by_folder, code_lines, of_a_default_run
from tests.architecture.sources import PACKAGE


def test_blank_lines_comments_and_docstrings_are_no_code() -> None:
    """A statement over several lines counts each of them; a string that is a value counts."""
    source = '''"""A module."""

# a comment
def area(width: float,
         height: float) -> float:  # two lines
    """Its docstring
    has two lines."""
    text = """a value
    of two lines"""
    return width * height
'''
    assert code_lines(source) == 5


def test_the_package_stays_small() -> None:
    """It may shrink; the aim of this version is 22,000 lines of code."""
    assert sum(by_folder(PACKAGE).values()) <= 24_939


@pytest.mark.process
def test_a_default_run_imports_a_part_of_the_package() -> None:
    """At most 15,150 lines of code, as sweeps, studies and errors have modules of their own."""
    assert 10_000 < of_a_default_run(PACKAGE) <= 15_150
