"""MuJoCo's swimmer as a domain, with a display and without one."""

from __future__ import annotations

import os
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from islandgp.domain import RewardTable
from islandgp.domains.gymnasium import rendering
from islandgp.domains.gymnasium.domain import Gymnasium
from islandgp.domains.gymnasium.world import GymnasiumWorld
from islandgp.errors import ConfigError
from islandgp.experiment import compose
from islandgp.testing import check_domain
from tests.composed import composed, plain
from tests.trees.shell import Cli, shell

pytest.importorskip("gymnasium", reason="extra `gymnasium` is not installed")

TREES = Path(__file__).parents[2] / "islandgp" / "domains" / "gymnasium" / "trees"
SWIMMER = TREES / "swimmer.bt"
needs_mujoco = pytest.mark.skipif(
    find_spec("mujoco") is None, reason="extra `mujoco` is not installed"
)


@pytest.fixture
def islandgp(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Cli:
    """Runs `islandgp ARGUMENTS...`; see `shell`."""
    return shell(monkeypatch, capsys)


@pytest.fixture(autouse=True)
def forget_backend(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each test chooses a backend for itself."""
    monkeypatch.setenv("MUJOCO_GL", "egl")  # restored afterwards, if a test sets it
    monkeypatch.delenv("MUJOCO_GL")
    rendering.choose_backend.cache_clear()


@pytest.mark.slow
@needs_mujoco
def test_swimmer_keeps_the_promises_of_a_domain() -> None:
    """The contract's tests, with short episodes."""
    make = composed("domain=swimmer", "world.ticks=15").make_domain
    texts = [SWIMMER.read_text(encoding="utf-8")]
    assert check_domain(make, trees=texts, random_trees=2).faults == {}


@needs_mujoco
def test_the_tree_by_hand_swims() -> None:
    """Its tier is the best one."""
    swimmer = compose("domain=swimmer", "tracking=off", "evaluator=serial")
    (outcome,) = swimmer.evaluate(SWIMMER.read_text(encoding="utf-8"), [300_000])
    assert outcome.counters["return"] > 200


@needs_mujoco
@pytest.mark.process
def test_a_page_has_frames_if_a_backend_renders(islandgp: Cli, tmp_path: Path) -> None:
    """`MUJOCO_GL` is set to the backend that was found."""
    page = tmp_path / "page.html"
    result = islandgp("replay", SWIMMER, "-o", page, "--set", "world.ticks=20")
    assert result.code == 0, result.err
    assert ('"frames":["iVBOR' in page.read_text(encoding="utf-8")) == rendering.choose_backend()
    assert ("MUJOCO_GL" in os.environ) == rendering.choose_backend()


@needs_mujoco
@pytest.mark.process
def test_a_backend_that_aborts_is_left_out() -> None:
    """The child process ends with an error; this one goes on."""
    assert not rendering._renders("no-such-backend")


def test_backends_are_tried_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """Up to the first that renders."""
    backends: list[str] = []

    def renders(name: str) -> bool:
        backends.append(name)
        return name == "osmesa"

    monkeypatch.setattr(rendering, "BACKENDS", ("egl", "osmesa", "glfw"))
    monkeypatch.setattr(rendering, "_renders", renders)
    assert rendering.choose_backend()
    assert (backends, os.environ["MUJOCO_GL"]) == (["egl", "osmesa"], "osmesa")


def test_a_chosen_backend_is_the_only_one_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """`MUJOCO_GL` stays as the user set it."""
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    monkeypatch.setattr(rendering, "_renders", lambda name: name == "egl")
    assert not rendering.choose_backend()
    assert os.environ["MUJOCO_GL"] == "glfw"


def test_a_page_without_a_backend_has_no_frames(
    islandgp: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`replay` and `trace` end well. CartPole takes the place of an environment of MuJoCo."""
    monkeypatch.setattr(rendering, "is_mujoco", lambda _: True)
    monkeypatch.setattr(rendering, "_renders", lambda _: False)
    page, quick = tmp_path / "page.html", ("--set", "world.ticks=20")
    assert islandgp("replay", TREES / "cartpole.bt", "-o", page, *quick).code == 0
    assert '"frames":["' not in page.read_text(encoding="utf-8")
    assert islandgp("trace", TREES / "cartpole.bt", *quick).code == 0


@pytest.mark.parametrize(
    ("fault", "backend", "remedy"),
    [
        ('MuJoCo is not installed, run `pip install "gymnasium[mujoco]"`', "", "islandgp[mujoco]"),
        ("'NoneType' object has no attribute 'glGetError'", "osmesa", "MUJOCO_GL=osmesa here"),
    ],
)
def test_why_mujoco_cannot_be_imported(
    monkeypatch: pytest.MonkeyPatch, fault: str, backend: str, remedy: str
) -> None:
    """One line with the remedy."""

    def environment(*_: object) -> None:
        raise AttributeError(fault)

    monkeypatch.setenv("MUJOCO_GL", backend)
    monkeypatch.delitem(sys.modules, "mujoco", raising=False)
    monkeypatch.setattr(rendering, "find_spec", lambda _: object())
    world = GymnasiumWorld.model_validate(plain("domain=swimmer")["world"])
    monkeypatch.setattr("islandgp.domains.gymnasium.domain.environment", environment)
    domain = Gymnasium(world, RewardTable(events={}))
    with pytest.raises(ConfigError) as excinfo:
        domain.environment(render=False)
    assert remedy in str(excinfo.value)
