"""What counts as a line of code."""

from __future__ import annotations

from tests.architecture.code_lines import code_lines


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
