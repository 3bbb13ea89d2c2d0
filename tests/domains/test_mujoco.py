"""MuJoCo's swimmer as a domain, with a display and without one."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import pytest

from islandgp.experiment import compose
from islandgp.testing import check_domain
from tests.composed import composed
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


@pytest.mark.parametrize("backend", ["", "egl"])
def test_a_page_has_frames_with_a_backend(
    islandgp: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, backend: str
) -> None:
    """`MUJOCO_GL` names it. CartPole takes the place of an environment of MuJoCo."""
    quality = SimpleNamespace(shadowsize=4096, offsamples=4)
    cart_pole = "gymnasium.envs.classic_control.cartpole.CartPoleEnv"
    monkeypatch.setenv("MUJOCO_GL", backend)
    monkeypatch.setattr(f"{cart_pole}.mujoco_renderer", object(), raising=False)
    model = SimpleNamespace(vis=SimpleNamespace(quality=quality))
    monkeypatch.setattr(f"{cart_pole}.model", model, raising=False)
    page = tmp_path / "page.html"
    assert (
        islandgp("replay", TREES / "cartpole.bt", "-o", page, "--set", "world.ticks=20").code == 0
    )
    assert ('"frames":["' in page.read_text(encoding="utf-8")) == bool(backend)
    assert quality.shadowsize == (0 if backend else 4096)
