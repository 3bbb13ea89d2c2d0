"""Reads XML with the line of each element, and the trees of BehaviorTree.CPP files."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Final
from xml.parsers import expat

from islandgp.bt.core.includes import MAX_FILES, included_path
from islandgp.bt.core.source import shown
from islandgp.errors import TreeError

DEEPEST: Final = 300  # most levels of elements
MAX_XML: Final = 1_000_000  # characters that are read of another file
MAX_SIBLINGS: Final = 1_000  # most files of the folder in which a tree is looked up


@dataclass(slots=True)
class Element:
    """An element."""

    tag: str
    attributes: dict[str, str]
    file: str  # its name in messages
    line: int  # from 1
    column: int
    children: list[Element] = field(default_factory=list)
    comments: tuple[str, ...] = ()  # and texts, before it and after its last child

    def error(self, message: str, kind: type[TreeError] = TreeError) -> TreeError:
        """The error for an element, with its place."""
        place = f"{self.file}:{self.line}:{self.column}"
        return kind(f"{place}: {message}", line=self.line, column=self.column)


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

    def here(tag: str, attributes: dict[str, str]) -> Element:
        line, column = parser.CurrentLineNumber, parser.CurrentColumnNumber + 1
        return Element(tag, attributes, name, line, column, comments=(*comments,))

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = here(tag, attributes)
        if len(open_elements) >= DEEPEST:
            raise element.error(f"expected at most {DEEPEST} nested elements")
        comments.clear()
        (open_elements[-1].children if open_elements else roots).append(element)
        open_elements.append(element)

    def end(_: str) -> None:
        open_elements.pop().comments += (*comments,)
        comments.clear()

    def text_between(text: str) -> None:
        comments.extend(filter(None, [text.strip()]))

    def doctype(*_: object) -> None:
        raise here("", {}).error("expected no document type")

    parser.buffer_text = True
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.StartDoctypeDeclHandler = doctype
    parser.CharacterDataHandler = text_between
    parser.CommentHandler = comments.append
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        reason, line, column = expat.ErrorString(error.code), error.lineno, error.offset + 1
    except UnicodeEncodeError as error:  # a lone surrogate; expat reads bytes
        reason, line, column = "it is not UTF-8 text", text.count("\n", 0, error.start) + 1, 1
    else:
        return roots[0]
    raise Element("", {}, name, line, column).error(f"not XML: {reason}")


class XmlTrees:
    """The trees of a file, of those that it includes, and of others in its folder, by ID."""

    def __init__(self, main: Element, folder: Path | None) -> None:
        """Reads the files.

        Args:
            main: the root of the file.
            folder: of the file; included files are there or below. None: includes are errors.

        Raises:
            TreeError: a file has another format, cannot be read, or defines an ID again.
        """
        self.by_id: dict[str, Element] = {}
        self._folder = folder
        self._read = set() if folder is None else {(folder / Path(main.file).name).resolve()}
        self._add(main, folder)
        if not self.by_id:
            raise main.error("expected <root> with a <BehaviorTree>, found none")

    def find(self, identity: str) -> Element | None:
        """The tree of an ID, also if it is in a file beside the main one that is not included."""
        if identity not in self.by_id and self._folder is not None:
            for path in islice(sorted(self._folder.glob("*.xml")), MAX_SIBLINGS):
                with suppress(OSError, ValueError, TreeError):
                    text = _text_of(path)
                    if f'ID="{identity}"' not in text:
                        continue
                    for element in read_xml(text, name=path.name).children:
                        if element.tag == "BehaviorTree" and element.attributes.get("ID"):
                            self.by_id.setdefault(element.attributes["ID"], element)
        return self.by_id.get(identity)

    def _add(self, root: Element, beside: Path | None) -> None:
        """Adds the trees of a file in the folder `beside`, and of those that it includes."""
        version = root.attributes.get("BTCPP_format", "3")
        if root.tag != "root" or version not in ("3", "4"):
            raise root.error(
                'expected <root BTCPP_format="4">, found'
                f" <{shown(root.tag)}> of version {shown(version)}"
            )
        for element in root.children:
            if element.tag == "include":
                self._include(element, beside)
            elif element.tag == "BehaviorTree":
                identity = element.attributes.get("ID", "")
                if identity in self.by_id:
                    raise element.error(f"the tree {shown(identity)} is defined twice; rename one")
                self.by_id[identity] = element
            elif element.tag != "TreeNodesModel":
                raise element.error(f"expected a <BehaviorTree>, found <{shown(element.tag)}>")

    def _include(self, element: Element, beside: Path | None) -> None:
        """Adds the trees of the file that an <include> names, unless they are known."""
        attribute = element.attributes.get("path", "")
        try:
            path = included_path(attribute, self._folder, beside)
            if path in self._read:
                return
            text = _text_of(path) if len(self._read) <= MAX_FILES else ""
        except (OSError, ValueError):
            text = ""
        if not (text and self._folder):
            raise element.error(
                f"expected the path of a text in the folder of the tree or below, one of at most"
                f" {MAX_FILES}, found {shown(attribute)}"
            )
        self._read.add(path)
        name = str(path.relative_to(self._folder.resolve()))
        self._add(read_xml(text, name=name), path.parent)


def _text_of(path: Path) -> str:
    """The text of a file, or the first characters of a long one; "" for what is no file."""
    if not path.is_file():  # a pipe could block
        return ""
    with path.open(encoding="utf-8") as stream:
        return stream.read(MAX_XML)
