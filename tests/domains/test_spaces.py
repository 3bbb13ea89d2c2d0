"""Which spaces of Gymnasium are read and filled, and how."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from islandgp.domains.gymnasium.spaces import Spaces
from islandgp.domains.gymnasium.world import Observation
from islandgp.errors import ConfigError, DomainError
from tests.composed import composed

spaces = pytest.importorskip("gymnasium.spaces", reason="extra `gymnasium` is not installed")


def of(observed: Any, actions: Any) -> Spaces:
    return Spaces.of(SimpleNamespace(observation_space=observed, action_space=actions), "Toy-v0")


def test_a_dict_is_read_by_key_and_place() -> None:
    """Its numbers are in the order of its keys; `key.place` names one of them."""
    space = spaces.Dict(
        {
            "arm": spaces.Box(-1, 1, (2,)),
            "cell": spaces.Discrete(5),
            "inner": spaces.Dict({"lights": spaces.MultiBinary(2)}),
        }
    )
    flattened = of(space, spaces.Discrete(2))
    observation = {
        "arm": np.array([0.25, -0.5], np.float32),
        "cell": np.int64(3),
        "inner": {"lights": np.array([0, 1], np.int8)},
    }
    assert flattened.read(observation) == [0.25, -0.5, 3, 0, 1]
    assert flattened.places["arm.1"] == 1
    assert flattened.places["cell"] == 2
    assert flattened.places["inner.lights.1"] == 4
    assert flattened.places[4] == 4


@pytest.mark.parametrize(
    ("space", "value", "numbers"),
    [
        (spaces.Discrete(4), np.int64(2), [2]),
        (spaces.MultiDiscrete([3, 4]), np.array([1, 3]), [1, 3]),
        (spaces.Box(0, 1, (3,)), np.array([0.5, 0, 1]), [0.5, 0, 1]),
        (
            spaces.Tuple((spaces.Discrete(4), spaces.Box(0, 1, (2,)))),
            (np.int64(3), np.array([0.5, 1])),
            [3, 0.5, 1],
        ),
    ],
)
def test_rows_and_single_numbers_are_read(space: Any, value: Any, numbers: list[float]) -> None:
    """An observation becomes a list of its numbers."""
    assert of(space, spaces.Discrete(2)).read(value) == numbers


def test_actions_are_made_of_the_space_s_type() -> None:
    """A Box gets an array of its type; zeros are cut to its bounds."""
    box = of(spaces.Discrete(2), spaces.Box(np.float32([-1, 0.5]), np.float32([1, 2])))
    assert box.none == (0.0, 0.5)
    action = box.act([0.25, 1.5])
    assert (action.tolist(), action.dtype) == ([0.25, 1.5], np.float32)
    several = of(spaces.Discrete(2), spaces.MultiDiscrete([3, 2]))
    assert several.act((2, 1)).tolist() == [2, 1]
    assert several.accepts((2, 1))
    assert not any(map(several.accepts, [(3, 0), (1.5, 1), (1,), 1]))
    assert not any(map(of(spaces.Discrete(2), spaces.Discrete(3)).accepts, [3, (1,)]))
    lights = of(spaces.Discrete(2), spaces.MultiBinary(2))
    assert (lights.act((1, 0)).tolist(), lights.none) == ([1, 0], (0.0, 0.0))
    assert not lights.accepts((2, 0))


@pytest.mark.parametrize(
    ("actions", "default", "valid", "invalid"),
    [
        (spaces.Discrete(3, start=-1), -1, 1, 2),
        (spaces.MultiDiscrete([2, 3], start=[4, 0]), (4, 0), (5, 2), (6, 0)),
    ],
)
def test_choices_that_do_not_begin_at_0(
    actions: Any, default: Any, valid: Any, invalid: Any
) -> None:
    """The configuration has the environment's own numbers; without a choice it is the first."""
    flattened = of(spaces.Discrete(2), actions)
    assert flattened.none == default
    assert flattened.accepts(valid)
    assert not flattened.accepts(invalid)


@pytest.mark.parametrize(
    ("observed", "actions", "message"),
    [
        (spaces.Box(0, 1, (8, 8, 3)), spaces.Discrete(2), "expected observations that are numbers"),
        (spaces.Text(5), spaces.Discrete(2), "expected observations that are numbers"),
        (spaces.Discrete(2), spaces.Text(5), "expected actions to choose from"),
    ],
)
def test_other_spaces_are_refused(observed: Any, actions: Any, message: str) -> None:
    """Pictures, texts and the like are no keys, and no actions."""
    with pytest.raises(ConfigError, match=message):
        of(observed, actions)


@pytest.mark.parametrize(
    ("override", "line"),
    [
        (
            "actions.Turn.arguments.torque.at=1",
            "actions.Turn.arguments.torque.at: expected the place",
        ),
        ("actions.Turn.arguments.torque.range=[-3,3]", "actions.Turn.arguments.torque.range: exp"),
        ("actions.Turn.arguments.torque.range=[2,1]", "actions.Turn.arguments.torque.range: exp"),
        ("otherwise=[3]", "otherwise: expected an action of Pendulum-v1, Box("),
        ("otherwise=1", "otherwise: expected an action of Pendulum-v1, Box("),
        ("observations.up.at=cosine", "observations.up.at: expected 0 to 2"),
    ],
)
def test_wrong_configuration_is_one_line(override: str, line: str) -> None:
    """Key, what was expected and found."""
    with pytest.raises(ConfigError) as excinfo:
        composed("domain=pendulum", f"++world.{override}")
    assert str(excinfo.value).startswith(f"world.{line}")


def test_an_argument_with_a_wrong_default_is_named() -> None:
    """With its action and its domain."""
    where = "the argument torque of the action Turn of the domain pendulum"
    with pytest.raises(DomainError, match=rf"a default of -2 to 2.* {where}, found"):
        composed("domain=pendulum", "++world.actions.Turn.arguments.torque.default=9")


@pytest.mark.parametrize(("value", "number"), [(0, 0.0), (1.6, 2.0), (7, 2.0), (-1, 0.0)])
def test_words_of_an_observation(value: float, number: float) -> None:
    """A number that counts from 0 is a word; beyond the words it is the first or the last."""
    key = Observation(at=0, meaning="m", words=("red", "green", "blue")).key(())
    assert key.words == ("red", "green", "blue")
    low, high = key.bounds
    assert round(min(high, max(low, value))) == number


def test_whole_numbers_of_an_observation() -> None:
    """Discrete numbers and boxes of integers are whole, boxes of floats are not."""
    box, row = spaces.Box(0, 1, (2,)), spaces.Box(0, 9, (1,), np.int64)
    space = spaces.Tuple((spaces.Discrete(4), box, spaces.Dict({"row": row})))
    assert of(space, spaces.Discrete(2)).whole == (True, False, False, True)
