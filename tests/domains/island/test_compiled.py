"""The compiled loop gives the same episodes as Python's, and is left out where it cannot be."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from shutil import copytree, ignore_patterns

import pytest

import islandgp.domains.island
from islandgp import cached_files
from islandgp.bt.core.language import parse
from islandgp.domains.island import compiled, episode
from islandgp.domains.island.episode import run_episode
from islandgp.domains.island.state import State, build_island
from islandgp.domains.island.world import IslandWorld
from islandgp.resources import resource
from tests.domains.island.days import points, world
from tests.domains.island.test_determinism import ALL_ROUNDER, RESTLESS, busy, gp_tree
from tests.profiles import sweep

WAITING = "selector { MoveToHumanoid when batteryLevel < 5 { ExecuteCharge } }"


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The first episode may be compiled."""
    monkeypatch.setattr(compiled, "WARM", 0)
    compiling, at_hand = compiled._functions, compiled._at_hand
    compiling.cache_clear()
    yield
    compiling.cache_clear()
    at_hand.cache_clear()


@sweep("island", [busy(), world()], ids=["busy", "usual"], quick=1)
@pytest.mark.usefixtures("at_once")
def test_outcomes_are_the_same(island: IslandWorld, monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last bit, and with as many ticks: full, waiting and random trees."""
    pytest.importorskip("numba", reason="needs islandgp[fast]")
    trees = [*map(parse, (ALL_ROUNDER, RESTLESS, WAITING)), *map(gp_tree, range(6))]
    quick = [run_episode(tree, island, seed, points()) for seed, tree in enumerate(trees)]
    assert compiled._functions() is not None
    monkeypatch.setattr(compiled, "_functions", lambda: None)
    assert quick == [run_episode(tree, island, seed, points()) for seed, tree in enumerate(trees)]


@pytest.mark.usefixtures("at_once")
def test_crowded_episodes_are_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a body touches two others at once, the outcome is that of every step."""
    pytest.importorskip("numba", reason="needs islandgp[fast]")
    people = world().humanoids.model_copy(update={"count": 40, "speed": 9.0})
    island, trees = world().model_copy(update={"humanoids": people}), [parse(ALL_ROUNDER)] * 8
    may_coast_values: list[bool] = []

    def counted(state: State, *, may_coast: bool = True) -> compiled.Compiled | None:
        may_coast_values.append(may_coast)
        return compiled.compiled_for(state, may_coast=may_coast)

    monkeypatch.setattr(episode, "compiled_for", counted)
    quick = [run_episode(tree, island, seed, points()) for seed, tree in enumerate(trees)]
    assert False in may_coast_values
    assert True in may_coast_values
    monkeypatch.setattr(compiled, "_functions", lambda: None)
    assert quick == [run_episode(tree, island, seed, points()) for seed, tree in enumerate(trees)]


@pytest.mark.usefixtures("at_once")
def test_coasting_needs_the_sums_of_chipmunk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where compiled sums are rounded in another way, Chipmunk makes every step."""
    pytest.importorskip("numba", reason="needs islandgp[fast]")
    functions = compiled._functions()
    assert functions is not None
    assert functions.may_coast
    assert not compiled._adds_as_chipmunk(lambda *_: None)
    before = run_episode(parse(ALL_ROUNDER), world(), 3, points())
    monkeypatch.setattr(compiled, "_functions", lambda: functions._replace(may_coast=False))
    assert run_episode(parse(ALL_ROUNDER), world(), 3, points()) == before


@pytest.mark.parametrize("module", ["numba", "a numba that works", "Chipmunk's functions"])
@pytest.mark.usefixtures("at_once")
def test_python_does_without_it(module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without numba, with one that cannot be imported, and with a pymunk that hides functions."""
    if module == "numba":
        monkeypatch.setattr(compiled, "find_spec", lambda _: None)
    elif module == "a numba that works":
        monkeypatch.setattr(compiled, "find_spec", lambda _: object())
        monkeypatch.setitem(sys.modules, "islandgp.domains.island.machine_code", None)
        monkeypatch.delattr(islandgp.domains.island, "machine_code", raising=False)
    else:
        monkeypatch.setattr(compiled.engine, "addresses", {})
    assert compiled.compiled_for(build_island(world(), 0, points(), ())) is None


def test_short_commands_do_not_compile(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first episodes of a process use compiled functions only if these are in a file."""
    monkeypatch.setattr(compiled, "_episodes", iter(range(compiled.WARM)))
    monkeypatch.setattr(compiled, "_at_hand", lambda: False)
    monkeypatch.setattr(compiled, "_functions", lambda: pytest.fail("compiled"))
    island = build_island(world(), 0, points(), ())
    assert all(compiled.compiled_for(island) is None for _ in range(compiled.WARM))


IMPORTED = """
import sys
from islandgp.domains.island import compiled
assert compiled._functions() is not None
print("numba" in sys.modules)
"""


def test_numba_is_imported_once(tmp_path: Path) -> None:
    """The process that makes the file imports numba; later ones do not."""
    pytest.importorskip("numba", reason="needs islandgp[fast]")
    package = tmp_path / "islandgp"
    copytree(resource("islandgp"), package, ignore=ignore_patterns("__pycache__"))

    def imports_numba() -> str:
        command, environment = (
            [sys.executable, "-c", IMPORTED],
            {**os.environ, "PYTHONPATH": str(tmp_path)},
        )
        return subprocess.run(
            command, env=environment, capture_output=True, text=True, check=True, cwd=tmp_path
        ).stdout.strip()

    assert [imports_numba(), imports_numba()] == ["True", "False"]
    (file,) = package.glob("domains/island/__pycache__/*.o")
    file.write_bytes(file.read_bytes()[:-1])  # it was cut off
    assert [imports_numba(), imports_numba()] == ["True", "False"]


def test_without_a_folder_for_the_file_python_is_used(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Where no folder can be written, nothing is compiled in each process again."""
    machine_code = pytest.importorskip("islandgp.domains.island.machine_code")
    (tmp_path / "file").touch()
    monkeypatch.setattr(cached_files, "_places", lambda *_: [tmp_path / "file" / "kernel.o"])
    monkeypatch.setattr(machine_code, "_compiled", lambda: b"code")
    machine_code.addresses.cache_clear()
    with pytest.raises(OSError, match="none that can be written"):
        machine_code.addresses()


@pytest.mark.slow
@pytest.mark.process
def test_records_of_a_run_are_the_same(tmp_path: Path) -> None:
    """A run of the command with its validation, on workers that have compiled code or not."""
    pytest.importorskip("numba", reason="needs islandgp[fast]")
    (tmp_path / "sitecustomize.py").write_text("import sys\nsys.modules['llvmlite'] = None\n")
    overrides = ("gp.population=10", "gp.generations=12", "tracking=off", "progress=off")
    records: list[dict[str, bytes]] = []
    for name, path in (("with", ""), ("without", str(tmp_path))):
        subprocess.run(
            [sys.executable, "-m", "islandgp", *overrides, f"runs={tmp_path / name}"],
            cwd=resource("conf").parent,
            env={**os.environ, "PYTHONPATH": path},
            check=True,
            capture_output=True,
        )
        (folder,) = (tmp_path / name).glob("default/*")
        files = ("generations.jsonl", "best.bt", "lineage.csv", "archive.json")
        records.append({file: (folder / file).read_bytes() for file in files})
    assert records[0] == records[1]
