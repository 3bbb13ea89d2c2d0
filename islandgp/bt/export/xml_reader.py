"""Reads XML with the line of each element, and the trees of BehaviorTree.CPP files."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Final, NamedTuple
from xml.parsers import expat

from islandgp.bt.core.includes import MAX_FILES
from islandgp.bt.core.source import shown
from islandgp.errors import TreeError

DEEPEST: Final = 300  # most levels of elements
MAX_XML: Final = 1_000_000  # most characters of an included file
MAX_SIBLINGS: Final = 1_000  # most files of the folder in which a tree is looked up


@dataclass(slots=True)
class Element:
    """An element."""

    tag: str
    attributes: dict[str, str]
    line: int  # from 1
    column: int
    children: list[Element] = field(default_factory=list)
    comments: tuple[str, ...] = ()  # and texts, before it and after its last child

    def error(self, message: str, file: str, kind: type[TreeError] = TreeError) -> TreeError:
        """The error for an element of a file, with its place."""
        place = f"{file}:{self.line}:{self.column}"
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
        return Element(tag, attributes, line, column, comments=(*comments,))

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = here(tag, attributes)
        if len(open_elements) >= DEEPEST:
            raise element.error(f"expected at most {DEEPEST} nested elements", name)
        comments.clear()
        (open_elements[-1].children if open_elements else roots).append(element)
        open_elements.append(element)

    def end(_: str) -> None:
        open_elements.pop().comments += (*comments,)
        comments.clear()

    def text_between(text: str) -> None:
        comments.extend(filter(None, [text.strip()]))

    def doctype(*_: object) -> None:
        raise here("", {}).error("expected no document type", name)

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
    raise Element("", {}, line, column).error(f"not XML: {reason}", name)


class XmlTree(NamedTuple):
    """A `<BehaviorTree>`."""

    element: Element
    file: str  # its name in messages


class XmlTrees:
    """The trees of a file, of those that it includes, and of others in its folder, by ID."""

    def __init__(self, main: Element, name: str, folder: Path | None) -> None:
        """Reads the files.

        Args:
            main: the root of the file.
            name: of the file, in messages.
            folder: of the file; included files are there or below. None: includes are errors.

        Raises:
            TreeError: a file has another format, cannot be read, or defines an ID again.
        """
        self.by_id: dict[str, XmlTree] = {}
        self._included: set[Path] = set()
        self._top = None if folder is None else folder.resolve()
        top = () if self._top is None else ((self._top / Path(name).name).resolve(),)
        self._add(main, name, top)
        if not self.by_id:
            raise main.error("expected <root> with a <BehaviorTree>, found none", name)

    def find(self, identity: str) -> XmlTree | None:
        """The tree of an ID, also if it is in a file beside the main one that is not included."""
        if identity not in self.by_id and self._top is not None:
            for path in islice(sorted(self._top.glob("*.xml")), MAX_SIBLINGS):
                with suppress(OSError, ValueError, TreeError):
                    text = path.read_text(encoding="utf-8")
                    if f'ID="{identity}"' not in text or len(text) > MAX_XML:
                        continue
                    for element in read_xml(text, name=path.name).children:
                        if element.tag == "BehaviorTree" and element.attributes.get("ID"):
                            tree = XmlTree(element, path.name)
                            self.by_id.setdefault(element.attributes["ID"], tree)
        return self.by_id.get(identity)

    def _add(self, root: Element, file: str, above: tuple[Path, ...]) -> None:
        """Adds the trees of a file; `above`: its path, after those of the files that include it."""
        version = root.attributes.get("BTCPP_format", "3")
        if root.tag != "root" or version not in ("3", "4"):
            raise root.error(
                'expected <root BTCPP_format="4">, found'
                f" <{shown(root.tag)}> of version {shown(version)}",
                file,
            )
        for element in root.children:
            if element.tag == "include":
                self._include(element, file, above)
            elif element.tag == "BehaviorTree":
                identity = element.attributes.get("ID", "")
                if identity in self.by_id:
                    message = f"the tree {shown(identity)} is defined twice; rename one"
                    raise element.error(message, file)
                self.by_id[identity] = XmlTree(element, file)
            elif element.tag != "TreeNodesModel":
                tag = shown(element.tag)
                raise element.error(f"expected a <BehaviorTree>, found <{tag}>", file)

    def _include(self, element: Element, file: str, above: tuple[Path, ...]) -> None:
        """Adds the trees of the file that an <include> names."""
        attribute = element.attributes.get("path", "")
        if self._top is None or not attribute:
            raise element.error("expected the path of a file beside this one", file)
        try:
            path = (above[-1].parent / attribute).resolve()
            if Path(attribute).is_absolute() or not path.is_relative_to(self._top):
                message = f"{shown(attribute)} leads out of the folder of the tree"
                raise element.error(message, file)
            if path in above:
                raise element.error(f"{shown(path.name)} includes itself", file)
            if path in self._included:
                return
            self._included.add(path)
            if len(self._included) > MAX_FILES or not path.is_file():  # a pipe could block
                message = f"expected at most {MAX_FILES} files, found no file {shown(attribute)}"
                raise element.error(message, file)
            with path.open(encoding="utf-8") as stream:
                text = stream.read(MAX_XML)
        except (OSError, RuntimeError, ValueError):
            raise element.error(f"{shown(attribute)} cannot be read as UTF-8 text", file) from None
        name = str(path.relative_to(self._top))
        self._add(read_xml(text, name=name), name, (*above, path))
