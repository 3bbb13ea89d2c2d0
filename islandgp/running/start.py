"""Trees of another run's archive for generation 0 (`start=RUN`).

They are texts, parsed with the vocabulary of this run's domain; no code of the file is executed.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Limits, Node, within
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import ConfigError, TreeError, brief
from islandgp.records.archive_file import read_archive


@dataclass(frozen=True, slots=True)
class StartTrees:
    """Trees of an archive that a run starts with."""

    trees: tuple[Node, ...]  # best first, at most the population's size
    left_out: int  # number of unusable trees that are at least as good
    why: str  # reason for the first of them, or ""


def start_trees(start: str, vocabulary: Vocabulary, limits: Limits, most: int) -> StartTrees:
    """The best usable trees of an archive.

    Args:
        start: a run's folder, or its archive.json.
        vocabulary: of this run's domain.
        limits: of this run's trees.
        most: maximum number of trees, >= 1.

    Returns:
        The trees, with the number of those left out.

    Raises:
        ConfigError: the archive is of another domain, or has no usable tree.
        RunError: there is no archive, or it is damaged.
    """
    archive, _ = read_archive(Path(start))
    if archive.domain != vocabulary.domain:
        raise ConfigError(
            f"start={start}: expected an archive of the domain {vocabulary.domain}, found one of"
            f" {archive.domain}; give a run of this domain, in any world."
        )
    trees: list[Node] = []
    reasons: list[str] = []
    for elite in archive.best_first():
        if len(trees) == most:
            break
        try:
            tree = parse(elite.tree, vocabulary, name=f"{start}, elite {elite.id}")
        except TreeError as error:
            reasons.append(brief(error))
            continue
        if within(tree, limits):
            trees.append(tree)
        else:
            reasons.append("it breaks gp.max_depth or gp.max_nodes")
    if not trees:
        why = f" ({reasons[0]})" if reasons else ""
        raise ConfigError(
            f"start={start}: expected trees that this run can use, found none{why}; give another"
            " run, or raise the limits."
        )
    return StartTrees(tuple(trees), len(reasons), reasons[0] if reasons else "")
