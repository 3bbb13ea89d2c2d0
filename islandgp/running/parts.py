"""The parts of a run, made from its settings, and the trees that open its population."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from islandgp.bt.analysis.conflicts import conflict_in_words
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Limits, Node, within
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.config.reads import keys_read
from islandgp.config.settings import Settings
from islandgp.domain import Domain
from islandgp.errors import ConfigError, TreeError, brief
from islandgp.evaluation.base import Evaluator
from islandgp.gp.plan import RUN_READS, Plan, declared, is_read, must_be_declared
from islandgp.plugin import path_of, plugin_errors
from islandgp.records.archive_file import best_first
from islandgp.records.folder import RunFolder
from islandgp.search.base import Search, SearchContext
from islandgp.supervision.base import RunContext, Supervisor
from islandgp.supervision.library import Library, library_folder, read_library
from islandgp.text_files import read_text_file

if TYPE_CHECKING:
    from islandgp.supervision.llm.budget import SupervisedRuns

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
        start: a file of a tree, or the folder of a finished run.
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
        archive = RunFolder(Path(start)).archive()
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
        content = to_text(_tree_of(start)).encode()
    else:
        content = RunFolder(Path(start)).archive().to_bytes()
    return hashlib.sha256(content).hexdigest()[:12]


def _tree_of(start: str, vocabulary: Vocabulary | None = None) -> Node:
    path = Path(start)
    return parse(read_text_file(path), vocabulary, name=start, folder=path.parent, marked=True)


def searched_library(settings: Settings) -> bool:
    """True if the run reads a library that a search has to find."""
    return settings.library.folder is None and is_read("library", keys_read(settings))


def run_context(
    settings: Settings, folder: Path | None = None, library: Library | None = None
) -> RunContext:
    """The arguments of a supervisor's `make`; parts that the search does not use are off.

    The library is loaded when the supervisor asks for it, unless it is given.
    """
    uses = settings.search.factory.uses
    problem, curriculum = settings.problem(), settings.curriculum
    domain = problem.domain
    reads = settings.supervisor.reads()
    keys = {*RUN_READS, *(key for part in reads.values() for key in part)}

    def loaded() -> Library:
        """Loads the library; an empty one if it would be searched for, and is not used."""
        must_be_declared("library", keys)
        if settings.library.folder is None and not searched_library(settings):
            return Library({}, {}, {}, {})
        return library or make_library(settings, domain)

    return RunContext(
        seed=settings.seed,
        generations=settings.gp.generations,
        limits=settings.gp.limits,
        folder=folder,
        schema=domain.schema,
        domain=domain,
        domain_in=lambda generation: problem.at(curriculum.stage(generation)),
        rewards=settings.rewards,
        classes=settings.classes,
        library=loaded,
        crisis=settings.gp.crisis,
        gp=declared(settings.gp, "gp", keys),
        curriculum=curriculum,
        adapt_mutation=settings.supervisor.adapt_mutation and "rate" in uses,
        inject=settings.supervisor.inject and "tree" in uses,
        edits=settings.supervisor.edits if "edits" in uses else 0,
        by_rate="rate" in uses,
        constraints=settings.constraints,
    )


def make_library(settings: Settings, domain: Domain) -> Library:
    """Loads the library of trees to inject. Raises ConfigError or TreeError.

    Without a folder a search finds a tree for each behaviour, once for all runs in `runs`.
    """
    library, vocabulary = settings.library, domain.schema.vocabulary
    if library.folder is None:
        from islandgp.running.automatic_library import automatic_library  # only without a folder

        return automatic_library(settings, domain, lambda: make_evaluator(settings))
    folder = library_folder(library.folder, domain)
    return read_library(library, folder, vocabulary, settings.classes)


def plan_of(
    settings: Settings,
    domain: Domain,
    library: Library | None = None,
    warn: Callable[[str], None] = lambda _: None,
) -> Plan:
    """The plan of a run, with the first trees of its population from a library or an archive.

    The library is loaded if it is needed and not given. `warn` is called with one line if trees
    of an archive are left out.

    Raises ConfigError, RunError or TreeError if these cannot be loaded.
    """
    plan = settings.plan(domain)
    if settings.start is not None:
        limits, most = plan.gp.limits, plan.gp.population
        trees = start_trees(settings.start, plan.vocabulary, limits, most, warn)
        return replace(plan, founders=trees)
    if not settings.gp.founders:
        return plan
    library = library or make_library(settings, domain)
    names = dict.fromkeys(name for target in library.targets.values() for name in target)
    founders = (library.trees[name] for name in names)
    return replace(plan, founders=tuple(t for t in founders if within(t, plan.gp.limits)))


def make_supervisor(
    settings: Settings, folder: Path | None, library: Library | None = None
) -> Supervisor:
    """Makes the configured supervisor. Raises SupervisionError if it cannot work."""
    part = settings.supervisor
    with plugin_errors(path_of(part.factory)):
        context = run_context(settings, folder, library)
        supervisor: Supervisor = part.factory.make(part.settings(), context)
        if not callable(getattr(supervisor, "advise", None)):
            kind = type(supervisor).__name__
            raise TypeError(f"expected make to return a supervisor, with advise, found {kind}")
    return supervisor


def supervised_runs(all_settings: Iterable[Settings]) -> list[SupervisedRuns]:
    """The runs that ask a language model; those that differ in the seed alone are put together."""
    from islandgp.supervision.llm.settings import LLMSettings

    groups: dict[str, list[tuple[Settings, LLMSettings]]] = {}
    for settings in all_settings:
        if isinstance(policy := settings.supervisor.settings(), LLMSettings):
            key = repr(settings.model_copy(update={"seed": 0}))
            groups.setdefault(key, []).append((settings, policy))
    if not groups:
        return []
    from islandgp.supervision.llm.budget import SupervisedRuns  # only with a language model

    return [
        SupervisedRuns(policy, run_context(settings), len(group))
        for group in groups.values()
        for settings, policy in group[:1]
    ]


def check_parts(settings: Settings) -> None:
    """Checks the parts of a run before it starts.

    Raises:
        SupervisionError: the supervisor cannot work, e.g. without a key.
        TrackingError: the tracker cannot store runs.
        ConfigError: the search does not support the settings, or the archive of `start` is of
            another domain.
        RunError: the archive of `start` is missing or damaged.
    """
    if settings.start is not None:
        plan_of(settings, settings.make_domain())
    tracking = settings.tracking
    if hasattr(tracking.factory, "check"):
        with plugin_errors(path_of(tracking.factory)):
            tracking.factory.check(tracking.settings(), Path.cwd())
    make_search(settings, settings.plan(settings.make_domain()))
    part = settings.supervisor
    if hasattr(part.factory, "check"):
        with plugin_errors(path_of(part.factory)):
            part.factory.check(part.settings(), run_context(settings))


def make_search(settings: Settings, plan: Plan) -> Search:
    """Makes the configured search. Raises ConfigError, TreeError or PartError."""
    part = settings.search
    keys = {*RUN_READS, *part.reads()}
    plan = replace(plan, gp=declared(plan.gp, "gp", keys))

    def library() -> Mapping[str, Node]:
        """The trees of the library's folder; {} without a folder, as a search is expensive."""
        must_be_declared("library", keys)
        if settings.library.folder is None:
            return {}
        return make_library(settings, settings.make_domain()).trees

    with plugin_errors(path_of(part.factory)):
        search: Search = part.factory.make(part.settings(), SearchContext(plan, library))
    return search


def make_evaluator(settings: Settings, *, perturbed: bool = False) -> Evaluator:
    """Makes the configured evaluator; `perturbed` as in `Settings.problem`."""
    part, problem = settings.evaluator, settings.problem(perturbed=perturbed)
    evaluator: Evaluator = part.factory.make(part.settings(), problem)
    return evaluator
