"""Trees for generation 0, from another run's archive (`start=RUN`) or a file (`start=FILE.bt`).

They are texts, parsed with the vocabulary of this run's domain; no code of the file is executed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Final

from islandgp.bt.analysis.conflicts import conflict_in_words
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Limits, Node, within
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import ConfigError, TreeError, brief
from islandgp.records.archive_file import best_first, read_archive
from islandgp.text_files import read_text_file

TREE_FILE: Final = ".bt"


def start_trees(
    start: str,
    vocabulary: Vocabulary,
    limits: Limits,
    most: int,
    warn: Callable[[str], None] = lambda _: None,
) -> tuple[Node, ...]:
    """Read the tree of a file, or the best usable trees of an archive.

    Args:
        start: a file of a tree, a run's folder, or its archive.json.
        vocabulary: of this run's domain.
        limits: of this run's trees.
        most: maximum number of trees, >= 1.
        warn: called with one line if trees are left out.

    Returns:
        The trees, best first, at most `most`; unusable ones are left out.

    Raises:
        ConfigError: the archive is of another domain, or no tree is usable.
        RunError: there is no archive, or it is damaged.
        TreeError: the file is not a tree of the vocabulary.
        IslandError: the file cannot be read.
    """
    trees: list[Node] = []
    reasons: list[str] = []

    def add(tree: Node) -> None:
        conflict = conflict_in_words(tree, vocabulary)
        if not within(tree, limits):
            reasons.append("it exceeds gp.max_depth or gp.max_nodes")
        elif conflict:
            reasons.append(conflict)
        else:
            trees.append(tree)

    if start.endswith(TREE_FILE):
        add(_tree_of(start, vocabulary))
    else:
        archive, _ = read_archive(Path(start))
        if archive.domain != vocabulary.domain:
            raise ConfigError(
                f"start={start}: expected an archive of the domain {vocabulary.domain}, found one"
                f" of {archive.domain}; give a run of this domain, in any world."
            )
        for elite in best_first(archive.elites):
            try:
                if len(trees) < most:
                    add(parse(elite.tree, vocabulary, name=f"{start}, elite {elite.id}"))
            except TreeError as error:
                reasons.append(brief(error))
    if not trees:
        raise ConfigError(
            f"start={start}: expected trees that this run can use, found none"
            f" ({(reasons or ['it has none'])[0]}); give another run or file, or raise the limits."
        )
    if reasons:
        warn(
            f"start={start}: {len(reasons)} of {len(reasons) + len(trees)} trees are left out, the"
            f" first because {reasons[0]}"
        )
    return tuple(trees)


def start_digest(start: str) -> str:
    """A digest of the content of `start`. Raises as `start_trees`."""
    if start.endswith(TREE_FILE):
        return hashlib.sha256(to_text(_tree_of(start)).encode()).hexdigest()[:12]
    return read_archive(Path(start))[1]


def _tree_of(start: str, vocabulary: Vocabulary | None = None) -> Node:
    path = Path(start)
    return parse(read_text_file(path), vocabulary, name=start, folder=path.parent, marked=True)
