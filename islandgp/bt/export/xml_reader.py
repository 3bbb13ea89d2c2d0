"""Reads XML with the line of each element, for error messages."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple, NoReturn
from xml.parsers import expat

from islandgp.errors import TreeError

DEEPEST = 300  # most levels of elements


class Text(NamedTuple):
    """A text between elements."""

    text: str
    line: int  # from 1
    column: int


@dataclass(slots=True)
class Element:
    """An element."""

    tag: str
    attributes: dict[str, str]
    line: int  # from 1
    column: int
    children: list[Element] = field(default_factory=list)
    comments: tuple[str, ...] = ()  # before it, and after its last child
    texts: list[Text] = field(default_factory=list)  # inside it, other than blanks

    def error(self, message: str, file: str, kind: type[TreeError] = TreeError) -> TreeError:
        """The error for an element of a file, with its place."""
        return placed_error(message, file, self.line, self.column, kind)


def placed_error(
    message: str, file: str, line: int, column: int, kind: type[TreeError] = TreeError
) -> TreeError:
    """The error for a place of a file."""
    return kind(f"{file}:{line}:{column}: {message}", line=line, column=column)


def read_xml(text: str, *, name: str) -> Element:
    """The root element.

    Raises:
        TreeError: the text is not well-formed, nested too deeply, or has a document type, whose
            entities could expand without bound.
    """
    parser = expat.ParserCreate()
    open_elements: list[Element] = []
    roots: list[Element] = []
    comments: list[str] = []  # since the last tag

    def fail(message: str, line: int, column: int) -> NoReturn:
        raise placed_error(message, name, line, column)

    def start(tag: str, attributes: dict[str, str]) -> None:
        line, column = parser.CurrentLineNumber, parser.CurrentColumnNumber + 1
        if len(open_elements) >= DEEPEST:
            fail(f"expected at most {DEEPEST} nested elements", line, column)
        element = Element(tag, attributes, line, column, comments=(*comments,))
        comments.clear()
        (open_elements[-1].children if open_elements else roots).append(element)
        open_elements.append(element)

    def end(_: str) -> None:
        open_elements.pop().comments += (*comments,)
        comments.clear()

    def text_between(text: str) -> None:
        if stripped := text.strip():
            before = text[: text.index(stripped)]
            column = parser.CurrentColumnNumber + 1 + len(before)
            open_elements[-1].texts.append(Text(stripped, parser.CurrentLineNumber, column))

    def doctype(*_: object) -> None:
        fail("expected no document type", parser.CurrentLineNumber, parser.CurrentColumnNumber + 1)

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.StartDoctypeDeclHandler = doctype
    parser.CharacterDataHandler = text_between
    parser.CommentHandler = comments.append
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        fail(f"not XML: {expat.ErrorString(error.code)}", error.lineno, error.offset + 1)
    except UnicodeEncodeError as error:  # a lone surrogate; expat reads bytes
        fail("not XML: it is not UTF-8 text", text.count("\n", 0, error.start) + 1, 1)
    return roots[0]
