"""The contract of `islandgp.domain` as tests: run them against a domain of your own.

    from islandgp.testing.domain_suite import DomainSuite

    class TestMaze(DomainSuite):
        def make_domain(self):
            return Maze.make(World(...), RewardTable(...))

pytest finds the tests in the subclass; `islandgp domain --check` runs them without pytest.
"""

from __future__ import annotations

import pickle
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import islice, pairwise
from math import isclose, isfinite

import numpy as np
import yaml

from islandgp.bt.engine import ABORTED
from islandgp.bt.language import parse
from islandgp.bt.node import AGAIN, FAILURE, STATUS_NAMES, Limits, Node, walk
from islandgp.domain import Domain, Observer, Outcome, Scene
from islandgp.evaluation.base import raised_in
from islandgp.evolution.random_trees import TreeSettings, TreeSpace, random_tree
from islandgp.resources import resource

SEEDS = (0, 1, 2**32 - 1)


class DomainSuite:
    """What every domain promises. A failing test says in words what was expected."""

    random_trees = 20  # of the suite, beside two trees for each action and `texts`
    texts: Sequence[str] = ()  # trees of your own, in the language

    def make_domain(self) -> Domain:
        """The domain under test, a new one at each call."""
        raise NotImplementedError("Give your domain in make_domain.")

    def trees(self, domain: Domain) -> Iterator[Node]:
        """Each action alone and behind the one declared before it, `texts`, and random trees."""
        words = domain.schema.vocabulary
        leaves = [Node("action", (name,)) for name in words.actions]
        yield from leaves
        yield from (Node("sequence", (), pair) for pair in pairwise((leaves[-1], *leaves)))
        yield from (parse(text, words) for text in self.texts)
        grown = yaml.safe_load(resource("conf/gp/paper.yaml").read_bytes())["trees"]
        how = TreeSettings.model_validate({**grown, "depth": (2, 4)})
        space = TreeSpace(how, words, Limits(max_depth=5, max_nodes=30))
        for slot in range(self.random_trees):
            yield random_tree(np.random.default_rng(slot), space)

    def watched(self) -> Iterator[tuple[Domain, Node, Outcome, _Seen]]:
        """A domain, and each of `trees` with what came of it in an episode that was watched."""
        domain = self.make_domain()
        for tree in self.trees(domain):
            seen = _Seen()
            yield domain, tree, domain.run_episode(tree, 0, {}, seen), seen

    def test_an_episode_is_a_function_of_tree_seed_and_weights(self) -> None:
        """The same again gives the same outcome, whatever ran before, in whatever instance."""
        one, other = self.make_domain(), self.make_domain()
        trees = list(self.trees(one))
        before = [one.run_episode(tree, seed, {}) for tree in trees for seed in SEEDS]
        after = [other.run_episode(tree, seed, {}) for tree in trees[::-1] for seed in SEEDS[::-1]]
        assert before == after[::-1], "Expected equal outcomes of equal episodes."

    def test_it_can_be_sent_to_workers(self) -> None:
        """Pickled and unpickled it runs the same episodes."""
        domain = self.make_domain()
        sent: Domain = pickle.loads(pickle.dumps(domain))
        for tree in islice(self.trees(domain), 10):
            here, there = (d.run_episode(tree, 0, {}) for d in (domain, sent))
            assert here == there, f"Expected the same outcome after pickling, of\n{tree}"

    def test_outcomes_have_what_the_schema_declares(self) -> None:
        """Components and counters in the schema's order, all finite; an end that is told."""
        domain = self.make_domain()
        for tree in self.trees(domain):
            o = domain.run_episode(tree, 0, {})
            assert list(o.components) == list(domain.schema.components), "components, in order"
            assert list(o.counters) == list(domain.schema.counters), "counters, in order"
            numbers = (*o.components.values(), *o.counters.values(), o.seconds)
            assert all(map(isfinite, numbers)), f"Expected finite numbers, found {o}."
            assert o.seconds > 0, "Expected an episode to take time."
            assert len(o.endings) == 1, "Expected one word for why the episode ended."
            assert o.endings[0], "Expected a word for why the episode ended, found an empty one."

    def test_a_component_that_is_not_named_has_the_weight_1(self) -> None:
        """No weights are weights of 1."""
        domain = self.make_domain()
        ones = dict.fromkeys(domain.schema.components, 1.0)
        for tree in self.trees(domain):
            plain, weighted = (domain.run_episode(tree, 0, weights) for weights in ({}, ones))
            assert plain == weighted, "Expected weights of 1 to change nothing."

    def test_an_observer_changes_nothing(self) -> None:
        """An episode that is watched has the same outcome."""
        for domain, tree, outcome, _ in self.watched():
            assert outcome == domain.run_episode(tree, 0, {}), "Expected the same when watched."

    def test_the_blackboard_keeps_its_ranges(self) -> None:
        """Flags are 0 or 1; numbers lie between the key's `low` and `most`."""
        for domain, _, _, seen in self.watched():
            keys = domain.schema.vocabulary.keys
            assert seen.boards, "Expected `observer.tick` to be called for each tick."
            for board in seen.boards:
                assert len(board) == len(keys), "Expected a value for each key of the vocabulary."
                for (name, key), value in zip(keys.items(), board, strict=True):
                    if key.flag:
                        assert value in (0, 1), f"Expected 0 or 1 of the flag {name}, found {value}"
                    else:
                        assert value >= key.low, f"Expected {name} >= {key.low}, found {value}"
                        assert key.most is None or value <= key.most, (
                            f"Expected {name} <= {key.most}, found {value}"
                        )

    def test_actions_return_the_statuses_that_they_declare(self) -> None:
        """`simplify` rewrites trees by these statuses."""
        for domain, tree, _, seen in self.watched():
            nodes = list(walk(tree))
            for place, status in seen.statuses:
                if nodes[place].kind == "action" and status not in (AGAIN, ABORTED):
                    name = str(nodes[place].args[0])
                    declared = domain.schema.vocabulary.actions[name].statuses
                    assert status in declared, (
                        f"Expected {name} to return"
                        f" {', '.join(STATUS_NAMES[s] for s in sorted(declared))},"
                        f" found {STATUS_NAMES[status]}."
                    )

    def test_credits_add_up_to_the_fitness(self) -> None:
        """What an observer is told of points is what the outcome holds, component by component."""
        for domain, _, outcome, seen in self.watched():
            sums = dict.fromkeys(domain.schema.components, 0.0)
            for component, points, event, action in seen.credits:
                assert component in sums, f"Expected a component of the schema, found {component!r}"
                assert event in domain.schema.events, f"Expected an event, found {event!r}"
                assert not action or action in domain.schema.vocabulary.actions, action
                sums[component] += points
            for name, points in outcome.components.items():
                assert isclose(sums[name], points, rel_tol=1e-9, abs_tol=1e-6), (
                    f"Expected credits of {points} for {name}, found {sums[name]}."
                )

    def test_counters_named_like_an_event_count_it(self) -> None:
        """Such a counter is how often the event was credited, where it earns points at all."""
        for domain, _, outcome, seen in self.watched():
            shared = domain.schema.counters.keys() & domain.schema.events.keys()
            counts = Counter(event for _, _, event, _ in seen.credits)
            for name in shared & counts.keys():
                assert outcome.counters[name] == counts[name], (
                    f"Expected {counts[name]} as the counter {name},"
                    f" found {outcome.counters[name]}."
                )

    def test_scenes_use_the_declared_forms(self) -> None:
        """Each thing has a form of the schema; movers are as many in each tick."""
        for domain, _, _, seen in self.watched():
            scenes = [scene for scene in seen.scenes if scene is not None]
            for scene in scenes:
                for thing in (*scene.fixed, *scene.items, *scene.movers):
                    assert thing.form in domain.schema.forms, f"Expected a form, found {thing}"
            assert len({len(scene.movers) for scene in scenes}) <= 1, "as many movers in each tick"

    def test_frames_are_pictures(self) -> None:
        """A simulator's own frame is a PNG."""
        domain = self.make_domain()
        tree = next(self.trees(domain))
        domain.run_episode(tree, 0, {}, _Pictures())


class _Seen(Observer):
    """Everything that an observer is told."""

    def __init__(self) -> None:
        self.statuses: list[tuple[int, int]] = []
        self.boards: list[tuple[float, ...]] = []
        self.scenes: list[Scene | None] = []
        self.credits: list[tuple[str, float, str, str]] = []

    def node(self, place: int, status: int) -> None:
        assert FAILURE <= status <= ABORTED, f"Expected a status, found {status}"
        self.statuses.append((place, status))

    def tick(self, board: Sequence[float], scene: Scene | None) -> None:
        self.boards.append(tuple(board))
        self.scenes.append(scene)

    def credit(self, component: str, points: float, event: str, action: str) -> None:
        self.credits.append((component, points, event, action))


class _Pictures(_Seen):
    """Looks at the first frames."""

    def tick(self, board: Sequence[float], scene: Scene | None) -> None:
        super().tick(board, scene)
        if scene is not None and scene.frame is not None and len(self.boards) <= 3:
            begin = scene.frame()[:8]
            assert begin == b"\x89PNG\r\n\x1a\n", f"Expected a PNG, found {begin!r}..."


def run_suite(suite: DomainSuite) -> Iterator[tuple[str, str]]:
    """Each test's promise, and what went wrong ("" for nothing), in the suite's order."""
    for name in vars(DomainSuite):
        if name.startswith("test_"):
            try:
                getattr(suite, name)()
            except AssertionError as error:
                yield _words(name), str(error) or "it does not hold"
            except Exception as error:  # whatever a domain raises breaks this promise
                what = f"{type(error).__name__}: {error}{raised_in(error)}"
                yield _words(name), f"Expected no error, found {what}"
            else:
                yield _words(name), ""


def _words(name: str) -> str:
    return name.removeprefix("test_").replace("_", " ")
