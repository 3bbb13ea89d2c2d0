"""The trees of another run's archive, which open generation 0 (`start=RUN`).

They are text that is parsed in the words of this run's domain, and nothing of a file is executed.
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
    """What a run takes of an archive."""

    trees: tuple[Node, ...]  # best first, at most as many as a population has
    left_out: int  # better or equal trees that this run cannot have
    why: str  # the reason of the first of them, or ""


def start_trees(start: str, vocabulary: Vocabulary, limits: Limits, most: int) -> StartTrees:
    """The best trees of an archive that a run can have.

    Args:
        start: a run's folder, or its archive.json.
        vocabulary: of this run's domain.
        limits: of this run's trees.
        most: trees.

    Raises:
        ConfigError: the archive is of another domain, or this run can have none of its trees.
        RunError: there is no archive, or it is damaged.
    """
    archive, _ = read_archive(Path(start))
    if archive.domain != vocabulary.domain:
        raise ConfigError(
            f"start={start}: expected an archive of the domain {vocabulary.domain}, found one of"
            f" {archive.domain}; give a run of this domain, in whatever world."
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
            f"start={start}: expected trees that this run can have, found none{why}; give another"
            " run, or raise the limits."
        )
    return StartTrees(tuple(trees), len(reasons), reasons[0] if reasons else "")
