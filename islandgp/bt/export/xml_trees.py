"""The trees of a BehaviorTree.CPP file, and of the files that it includes."""

from __future__ import annotations

from pathlib import Path
from typing import Final, NamedTuple

from islandgp.bt.core.includes import MAX_FILES
from islandgp.bt.core.source import shown
from islandgp.bt.export.xml_reader import Element, placed_error, read_xml

MAX_XML: Final = 1_000_000  # most characters of an included file


class XmlTree(NamedTuple):
    """A `<BehaviorTree>`."""

    element: Element
    file: str  # its name in messages


def trees_of(main: Element, name: str, folder: Path | None) -> dict[str, XmlTree]:
    """The trees of a file and of those that it includes, by ID.

    Args:
        main: the root of the file.
        name: of the file, in messages.
        folder: of the file; included files are there or below. None: includes are errors.

    Raises:
        TreeError: a file has another format, cannot be read, or defines an ID again.
    """
    trees: dict[str, XmlTree] = {}
    included: set[Path] = set()
    top = None if folder is None else folder.resolve()

    def add(root: Element, file: str, above: tuple[Path, ...]) -> None:
        if root.tag != "root":
            found_tag = f"found <{shown(root.tag)}>"
            raise root.error(f"expected <root> with a <BehaviorTree>, {found_tag}", file)
        version = root.attributes.get("BTCPP_format", "3")
        if version not in ("3", "4"):
            raise root.error(f'expected BTCPP_format="4", found version {shown(version)}', file)
        for element in root.children:
            if element.tag == "include":
                path, path_name = _included(element, file, top, above)
                if path in above:
                    raise element.error(f"{shown(path.name)} includes itself", file)
                if path not in included:
                    included.add(path)
                    if len(included) > MAX_FILES:
                        raise element.error(f"expected at most {MAX_FILES} included files", file)
                    text = _read(element, file, path)
                    add(read_xml(text, name=path_name), path_name, (*above, path))
            elif element.tag == "BehaviorTree":
                identity = element.attributes.get("ID", "")
                if identity in trees:
                    message = f"the tree {shown(identity)} is defined twice; rename one"
                    raise element.error(message, file)
                _check_texts(element, file)
                trees[identity] = XmlTree(element, file)
            elif element.tag != "TreeNodesModel":
                tag = shown(element.tag)
                raise element.error(f"expected a <BehaviorTree>, found <{tag}>", file)

    add(main, name, () if top is None else ((top / Path(name).name).resolve(),))
    if not trees:
        raise main.error("expected <root> with a <BehaviorTree>, found none", name)
    return trees


def _check_texts(tree: Element, file: str) -> None:
    """Raises TreeError for text between the nodes of a tree, which has no meaning."""
    waiting = [tree]
    while waiting:
        element = waiting.pop()
        for text, line, column in element.texts:
            message = (
                f"expected nodes in {shown(element.tag)}, found the text {shown(text)};"
                " make it a comment, <!-- ... -->"
            )
            raise placed_error(message, file, line, column)
        waiting += reversed(element.children)


def _included(
    element: Element, file: str, top: Path | None, above: tuple[Path, ...]
) -> tuple[Path, str]:
    """The file that an <include> names, and its name in messages.

    `top` is the folder of the main file; None: includes are errors.
    """
    attribute = element.attributes.get("path", "")
    if top is None or not attribute or "\0" in attribute:
        raise element.error("expected the path of a file beside this one", file)
    try:
        path = (above[-1].parent / attribute).resolve()
        inside = not Path(attribute).is_absolute() and path.is_relative_to(top)
    except (OSError, RuntimeError):
        raise element.error(f"there is no file {shown(attribute)}", file) from None
    if not inside:
        raise element.error(f"{shown(attribute)} leads out of the folder of the tree", file)
    return path, str(path.relative_to(top))


def _read(element: Element, file: str, path: Path) -> str:
    """The text of an included file."""
    attribute = element.attributes["path"]
    try:
        if not path.is_file():  # reading a pipe could block
            raise element.error(f"there is no file {shown(attribute)}", file)
        with path.open(encoding="utf-8") as stream:
            return stream.read(MAX_XML)
    except (OSError, UnicodeDecodeError):
        raise element.error(f"{shown(attribute)} cannot be read as UTF-8 text", file) from None
