"""The contract of `islandgp.domain` as tests that any domain can inherit.

    from islandgp.testing.domain_suite import DomainSuite

    class TestMaze(DomainSuite):
        def make_domain(self):
            return Maze.make(World(...), RewardTable(...))

pytest finds the tests in the subclass; `islandgp domain --check` runs them without pytest.
"""

from __future__ import annotations

import pickle
from collections.abc import Hashable, Iterator, Mapping, Sequence
from heapq import heappop, heappush
from itertools import combinations_with_replacement, count, islice, pairwise
from math import isclose, isfinite
from typing import ClassVar, Final

import numpy as np
import yaml

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import STATUS_NAMES, Limits, Node, ParallelArgs, leaf, sequence
from islandgp.domain import Domain, Observer, Outcome, prepare
from islandgp.errors import TimeLimitError
from islandgp.gp.random_trees import TreeSettings, TreeSpace, random_tree
from islandgp.resources import resource
from islandgp.testing.survey import (
    EpisodeRecorder,
    FrameChecker,
    ObservedRun,
    Survey,
    TickObserver,
    fault_text,
    tree_line,
    unreached,
)
from islandgp.time_limit import TimeLimit

SEEDS = (0, 1, 2**32 - 1)
MAX_FAULTS: Final = 10  # failed episodes that are reported


class DomainSuite:
    """Tests of the promises of a domain, for subclasses that define `make_domain`.

    A tree whose episode raises an exception is reported by the first test and left out of the
    others.
    """

    random_trees = 20  # number, besides two trees for each action and `texts`
    grown_trees = 60  # most sequences of actions, extended while they reach something new
    more_episodes = 30  # most further episodes of `own_trees`, until everything is reached
    texts: Sequence[str] = ()  # further trees, in the language
    episode_timeout = 30.0  # s, time limit of an episode; 0: none
    _cached_survey: ClassVar[Survey]  # of each subclass

    def make_domain(self) -> Domain:
        """Makes the domain under test: a new but equal instance at each call.

        Raises:
            NotImplementedError: the subclass does not define it.
        """
        raise NotImplementedError("Expected make_domain in the subclass, found none; define it.")

    def own_trees(self, domain: Domain) -> Iterator[Node]:
        """Trees that are known to reach events: those of `texts`.

        Args:
            domain: the domain under test.

        Yields:
            Each tree.
        """
        yield from (parse(text, domain.schema.vocabulary) for text in self.texts)

    def trees(self, domain: Domain) -> Iterator[Node]:
        """All trees of the tests.

        Args:
            domain: the domain under test.

        Yields:
            The trees of `own_trees`, each action alone and after the one before it in the
            vocabulary, and random trees.
        """
        vocabulary = domain.schema.vocabulary
        leaves = [leaf(name) for name in vocabulary.actions]
        yield from self.own_trees(domain)
        yield from leaves
        yield from (sequence(*pair) for pair in pairwise((leaves[-1], *leaves)))
        grown = yaml.safe_load(resource("conf/gp/paper.yaml").read_bytes())["trees"]
        settings = TreeSettings.model_validate({**grown, "depth": (2, 4)})
        space = TreeSpace(settings, vocabulary, Limits(max_depth=5, max_nodes=30))
        for slot in range(self.random_trees):
            yield random_tree(np.random.default_rng(slot), space)

    def watched(self) -> Iterator[tuple[Domain, Node, Outcome, EpisodeRecorder]]:
        """The domain and each tree that runs, with the outcome and observations of one episode."""
        survey = self._survey
        assert survey.runs, "Expected a tree whose episode runs, found none."
        for run in survey.runs:
            yield survey.domain, run.tree, run.watched, run.recorder

    def unseen(self) -> Iterator[str]:
        """A line for each event, action and key of the schema that no tree has reached."""
        yield from unreached(self._survey)

    def shared(self) -> Iterator[str]:
        """A line for actions that seem to share a resource that they do not declare.

        Two actions do if their order in a parallel changes an episode, and an action does with
        itself if two of it at once do not do the same as one.
        """
        actions = self._survey.domain.schema.vocabulary.actions
        acting = [name for name, action in actions.items() if not action.condition]
        for one, other in combinations_with_replacement(acting, 2):
            if {*actions[one].uses} & {*actions[other].uses}:
                continue
            first, second = leaf(one), leaf(other)
            both = Node("parallel", ParallelArgs("all", "all"), (first, second))
            swapped = first if one == other else both._replace(children=(second, first))
            before = dict.fromkeys((*actions[one].after, *actions[other].after))
            prepared = [leaf(name) for name in before]
            if self._seen(sequence(*prepared, both)) != self._seen(sequence(*prepared, swapped)):
                yield f"{one} with itself" if one == other else f"{one} and {other}"

    def _seen(self, tree: Node) -> list[Hashable]:
        """The first blackboards and movers of an episode; empty if it fails."""
        observed = TickObserver()
        try:
            self._run(self._survey.domain, tree, SEEDS[0], {}, observed)
        except (Exception, SystemExit):  # the first test reports it
            return []
        return observed.ticks

    @property
    def trees_run(self) -> int:
        """Number of trees that have run without an exception."""
        return len(self._survey.runs)

    @property
    def _survey(self) -> Survey:
        """The episodes of all trees with each seed; run once per class.

        pytest makes an instance for each test, so the result is an attribute of the class.
        """
        kind = type(self)
        if "_cached_survey" not in vars(kind):
            kind._cached_survey = self._new_survey()
        return kind._cached_survey

    def _new_survey(self) -> Survey:
        survey = Survey(self.make_domain())
        try:
            for tree in self.trees(survey.domain):
                self._look(survey, tree)
            self._grow(survey)
            self._visit(survey)
        except TimeLimitError:  # each tree with the same action would take as long
            pass
        return survey

    def _look(self, survey: Survey, tree: Node) -> ObservedRun | None:
        """Runs a tree with each seed and keeps the results; None if it raised an exception.

        Raises:
            TimeLimitError: an episode took too long; the error is kept as well.
        """
        domain, seed = survey.domain, SEEDS[0]
        recorder = EpisodeRecorder(tree, domain.schema)
        try:
            watched = self._run(domain, tree, seed, {}, recorder)
            plain = []
            for seed in SEEDS:
                plain.append(self._run(domain, tree, seed))
        except (Exception, SystemExit) as error:  # a simulator may call sys.exit
            survey.keep(error, seed, tree)
            if isinstance(error, TimeLimitError):
                raise
            return None
        run = ObservedRun(tree, watched, tuple(plain), recorder)
        survey.runs.append(run)
        return run

    def _grow(self, survey: Survey) -> None:
        """Runs sequences of actions and extends those that reached something new."""
        actions = [leaf(name) for name in survey.domain.schema.vocabulary.actions]
        reached: set[Hashable] = set()
        number = count()
        waiting: list[tuple[int, int, int, tuple[Node, ...]]] = [(0, 0, next(number), ())]
        remaining = self.grown_trees
        while waiting:
            *_, chain = heappop(waiting)
            for action in actions:
                if not remaining:
                    return
                remaining -= 1
                longer = (*chain, action)
                run = self._look(survey, sequence(*longer))
                if run is None:
                    continue
                firsts, states = run.recorder.firsts() - reached, run.recorder.states - reached
                reached |= firsts | states
                if firsts or states:
                    # Those with something that no sequence had shown come first, then the longest.
                    heappush(waiting, (0 if firsts else 1, -len(longer), next(number), longer))

    def _visit(self, survey: Survey) -> None:
        """Runs `own_trees` in further worlds until everything is reached."""
        domain, own_trees = survey.domain, [*self.own_trees(survey.domain)]
        trees = [run.tree for run in survey.runs if run.tree in own_trees]
        for n in range(self.more_episodes if trees else 0):
            seed, tree = SEEDS[0] + 1 + n // len(trees), trees[n % len(trees)]
            if not any(unreached(survey)):
                return
            recorder = EpisodeRecorder(tree, domain.schema)
            try:
                outcome = self._run(domain, tree, seed, {}, recorder)
            except (Exception, SystemExit) as error:
                survey.keep(error, seed, tree)
                if isinstance(error, TimeLimitError):
                    raise
            else:
                survey.visits.append(ObservedRun(tree, outcome, (outcome,), recorder))

    def _run(
        self,
        domain: Domain,
        tree: Node,
        seed: int,
        weights: Mapping[str, float] | None = None,
        observer: Observer | None = None,
    ) -> Outcome:
        """An episode within the time limit."""
        prepare(domain)
        with TimeLimit(self.episode_timeout):
            outcome = domain.run_episode(tree, seed, weights or {}, observer)
        assert isinstance(outcome, Outcome), f"Expected an Outcome, found {outcome!r:.80}"
        return outcome

    def test_every_episode_runs(self) -> None:
        """No tree makes an episode raise an exception or run forever."""
        faults = [
            f"{fault.text} (world seed {fault.seed}, tree {tree_line(fault.tree)})"
            for fault in self._survey.faults.values()
        ]
        assert not faults, "\n".join(faults[:MAX_FAULTS])

    def test_an_episode_is_a_function_of_tree_seed_and_weights(self) -> None:
        """Equal arguments give equal outcomes, in any order of episodes and in any instance."""
        runs, other = self._survey.runs, self.make_domain()
        for run in reversed(runs):
            for seed, before in zip(reversed(SEEDS), reversed(run.plain), strict=True):
                assert before == self._run(other, run.tree, seed), (
                    "Expected equal outcomes of equal episodes, found others of"
                    f" {tree_line(run.tree)}"
                )

    def test_it_can_be_sent_to_workers(self) -> None:
        """A pickled and unpickled domain gives the same outcomes."""
        domain = self.make_domain()
        copy: Domain = pickle.loads(pickle.dumps(domain))
        for run in islice(self._survey.runs, 10):
            assert run.plain[0] == self._run(copy, run.tree, SEEDS[0]), (
                f"Expected the same outcome after pickling, found another of {tree_line(run.tree)}"
            )

    def test_outcomes_have_what_the_schema_declares(self) -> None:
        """Components and counters are finite and in the schema's order; one ending is named."""
        schema = self._survey.domain.schema
        for run in self._survey.runs:
            for o in run.plain:
                assert list(o.components) == list(schema.components), (
                    f"Expected the components {', '.join(schema.components)}, in this order, found"
                    f" {', '.join(o.components)}"
                )
                assert list(o.counters) == list(schema.counters), (
                    f"Expected the counters {', '.join(schema.counters)}, in this order, found"
                    f" {', '.join(o.counters)}"
                )
                numbers = (*o.components.values(), *o.counters.values(), o.seconds)
                assert all(map(isfinite, numbers)), f"Expected finite numbers, found {o}."
                assert o.seconds > 0, "Expected an episode to take time."
                assert len(o.endings) == 1, "Expected one word for why the episode ended."
                assert o.endings[0], "Expected a word for why the episode ended, found an empty one"

    def test_a_component_that_is_not_named_has_the_weight_1(self) -> None:
        """Missing weights are 1."""
        domain = self._survey.domain
        ones = dict.fromkeys(domain.schema.components, 1.0)
        for run in self._survey.runs:
            assert run.plain[0] == self._run(domain, run.tree, SEEDS[0], ones), (
                "Expected weights of 1 to change nothing."
            )

    def test_recording_an_episode_keeps_its_outcome(self) -> None:
        """An episode has the same outcome with an observer."""
        for run in self._survey.runs:
            assert run.watched == run.plain[0], "Expected the same when watched."

    def test_keys_stay_in_their_ranges(self) -> None:
        """Flags are 0 or 1; numbers lie between the key's `low` and `most`."""
        for _, _, _, recorder in self.watched():
            assert recorder.ticks, "Expected `observer.tick` to be called for each tick."
            assert not recorder.wrong_board, recorder.wrong_board

    def test_actions_return_the_statuses_that_they_declare(self) -> None:
        """Actions return declared statuses only; `simplify` relies on them."""
        for domain, _, _, recorder in self.watched():
            for name, status in sorted(recorder.statuses):
                declared = domain.schema.vocabulary.actions[name].statuses
                assert status in declared, (
                    f"Expected {name} to return"
                    f" {', '.join(STATUS_NAMES[s] for s in sorted(declared))},"
                    f" found {STATUS_NAMES[status]}."
                )

    def test_points_of_actions_add_up_to_the_fitness(self) -> None:
        """The points credited to an observer add up to each component of the outcome."""
        for _, _, outcome, recorder in self.watched():
            assert not recorder.wrong_credit, recorder.wrong_credit
            for name, points in outcome.components.items():
                assert isclose(recorder.points[name], points, rel_tol=1e-9, abs_tol=1e-6), (
                    f"Expected credits of {points} for {name}, found {recorder.points[name]}."
                )

    def test_counters_named_like_an_event_count_it(self) -> None:
        """A counter with an event's name is the number of its credits, if it earns points."""
        for domain, _, outcome, recorder in self.watched():
            shared = domain.schema.counters.keys() & domain.schema.events.keys()
            for name in sorted(shared & recorder.credited.keys()):
                assert outcome.counters[name] == recorder.credited[name], (
                    f"Expected {recorder.credited[name]} as the counter {name},"
                    f" found {outcome.counters[name]}."
                )

    def test_scenes_use_the_declared_forms(self) -> None:
        """Each thing has a form of the schema; the number of movers is constant."""
        for _, _, _, recorder in self.watched():
            assert not recorder.wrong_scene, recorder.wrong_scene
            assert len(recorder.movers) <= 1, (
                f"Expected as many movers in each tick, found {sorted(recorder.movers)}"
            )

    def test_frames_are_png_images(self) -> None:
        """A simulator's own frame is a PNG."""
        for domain, tree, _, _ in islice(self.watched(), 1):
            self._run(domain, tree, SEEDS[0], {}, FrameChecker(tree, domain.schema))


def run_suite(suite: DomainSuite) -> Iterator[tuple[str, str]]:
    """Runs all tests of a suite, without pytest.

    Failed episodes are reported by the first test, one line each. If no episode runs at all, the
    other tests are skipped.

    Args:
        suite: of the domain under test.

    Yields:
        The name of each test in words and its failure, "" for none, in the suite's order.
    """
    for name in vars(DomainSuite):
        if not name.startswith("test_"):
            continue
        fault = ""
        try:
            getattr(suite, name)()
        except AssertionError as error:
            fault = str(error) or "it does not hold"
        except Exception as error:  # any exception of a domain is a failed test
            fault = fault_text(error)
        yield _sentence(name), fault
        if fault and not _has_run(suite):
            return


def _has_run(suite: DomainSuite) -> bool:
    """True if the episode of any tree has run."""
    try:
        return suite.trees_run > 0
    except Exception:  # make_domain failed, which the first test has reported
        return False


def _sentence(name: str) -> str:
    return name.removeprefix("test_").replace("_", " ")
