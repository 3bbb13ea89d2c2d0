"""Compiled modules (`islandgp compile`) give the same episodes and records as their sources."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

import pytest

from islandgp import extension_build, extension_modules
from islandgp.errors import IslandError
from islandgp.extension_modules import LIBRARY, SUFFIX, ExtensionFinder, compiled_folder
from islandgp.resources import resource
from tests.trees.shell import shell

COMPILED: Final = compiled_folder()
needs_compiled = pytest.mark.skipif(COMPILED is None, reason="needs `islandgp compile`")

EPISODES: Final = """
import sys
from islandgp.bt.core.language import parse
from islandgp.domains.island.episode import run_episode
from tests.domains.island.days import points, world
from tests.domains.island.test_determinism import ALL_ROUNDER, RESTLESS, busy, gp_tree

trees = [parse(ALL_ROUNDER), parse(RESTLESS), *map(gp_tree, range(30))]
for island in (world(), busy()):
    for seed, tree in enumerate(trees):
        print(run_episode(tree, island, seed, points()))
        print(run_episode(tree, busy(), seed, points(), stepwise=True))
print(sys.modules["islandgp.domains.island.episode"].__file__, file=sys.stderr)
"""


def in_python(*arguments: str, extensions: str, folder: Path | None = None) -> tuple[str, str]:
    """The output and the errors of a process of Python with extension modules ("1") or not.

    `folder`: the current folder, whose packages are imported; None: the project's.
    """
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder or resource("conf").parent,
        env={**os.environ, "ISLANDGP_EXTENSIONS": extensions},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout, done.stderr


@needs_compiled
@pytest.mark.process
def test_episodes_are_the_same() -> None:
    """To the last bit, also step by step, and with as many ticks."""
    compiled, used = in_python("-c", EPISODES, extensions="1")
    assert COMPILED is not None
    assert used.startswith(COMPILED)
    python, used = in_python("-c", EPISODES, extensions="0")
    assert used.strip().endswith("episode.py")
    assert compiled == python


@needs_compiled
@pytest.mark.process
def test_records_of_a_run_are_the_same(tmp_path: Path) -> None:
    """Of a run with a validation, in its worker processes; a trace of its best tree as well."""
    overrides = ("gp.population=10", "gp.generations=8", "tracking=off", "progress=off")
    records: list[Mapping[str, bytes]] = []
    for extensions in "01":
        runs = tmp_path / extensions
        in_python("-m", "islandgp", *overrides, f"runs={runs}", extensions=extensions)
        (folder,) = runs.glob("default/*")
        tree = str(folder / "best.bt")
        trace, _ = in_python(
            "-c", "from islandgp.cli import main; main()", "trace", tree, extensions=extensions
        )
        files = ("generations.jsonl", "best.bt", "lineage.csv", "archive.json")
        records.append({file: (folder / file).read_bytes() for file in files})
        records[-1] |= {"trace": trace.encode()}
    assert records[0] == records[1]


OWN_CODE: Final = """
import pickle
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Limits
from islandgp.domains.island.actions import ACTIONS, drive
from islandgp.domains.island.episode import run_episode
from islandgp.errors import TimeLimitError
from islandgp.plugin import raised_in
from islandgp.time_limit import TimeLimit
from tests.domains.island.days import points, world

def seek(island, fresh):
    return drive(island, None, 0.0, 1.0)  # line 13

episode = run_episode(parse("PatrolWaypoint"), world(), 0, points())
kept = (episode, Limits(8, 50), parse("when lap < 2 { SeekCharger }"))
assert pickle.loads(pickle.dumps(kept)) == kept
actions = {**ACTIONS, "SeekCharger": seek}
try:
    run_episode(parse("SeekCharger"), world(), 0, points(), actions=actions)
except TypeError as error:
    print(raised_in(error))
tree = "PickupGarbage"
for _ in range(6):
    tree = f"recovery 100 {{ {tree} inverter {{ PickupGarbage }} }}"
try:
    with TimeLimit(0.2):
        run_episode(parse(tree), world(), 0, points())
except TimeLimitError as error:
    print("late")
"""


@needs_compiled
@pytest.mark.process
def test_code_of_users(tmp_path: Path) -> None:
    """Episodes and trees are pickled, errors name the user's line, time limits end long ticks."""
    script = tmp_path / "own.py"
    script.write_text(f"import sys; sys.path.insert(0, {str(resource('conf').parent)!r}){OWN_CODE}")
    output, _ = in_python(str(script), extensions="1")
    assert output.splitlines() == [f", in {script}, line 13", "late"]


@needs_compiled
@pytest.mark.process
def test_changed_sources_are_run_by_python(tmp_path: Path) -> None:
    """Compiled modules of other sources are not used; nor is a part of a file."""
    assert COMPILED is not None
    package, compiled = tmp_path / "islandgp", Path(COMPILED)
    shutil.copytree(resource("islandgp"), package, ignore=shutil.ignore_patterns("__pycache__"))
    folder = package / "__pycache__" / compiled.name
    shutil.copytree(compiled, folder)
    command = "from islandgp.bt.core import closures; print(closures.__file__)"

    def used() -> str:
        return in_python("-c", command, extensions="1", folder=tmp_path)[0].strip()

    assert Path(used()).is_relative_to(folder)
    library = folder / f"{LIBRARY}{SUFFIX}"
    library.write_bytes(library.read_bytes()[:1000])
    assert used() == str(package / "bt" / "core" / "closures.py")
    shutil.copy(compiled / library.name, library)
    with (package / "bt" / "core" / "node.py").open("a") as source:
        source.write("# changed\n")
    assert used() == str(package / "bt" / "core" / "closures.py")


def test_the_digest_covers_all_constants_that_are_compiled_in() -> None:
    """Compiled modules import no constant from folders whose sources it does not cover."""
    package = resource("islandgp")
    files = [package / file for file in extension_modules.module_files()]
    folders = {".".join(("islandgp", *file.parent.relative_to(package).parts)) for file in files}
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("islandgp"):
                module = str(node.module)
                if module not in folders and module.rpartition(".")[0] not in folders:
                    assert not [alias.name for alias in node.names if alias.name.isupper()], file


def test_only_listed_modules_are_found() -> None:
    """Any other module is left to Python's own finders."""
    finder = ExtensionFinder("folder")
    spec = finder.find_spec("islandgp.bt.core.engine")
    assert spec is not None
    assert spec.origin == os.path.join("folder", f"islandgp/bt/core/engine{SUFFIX}")
    assert finder.find_spec("islandgp.bt.core.node") is None


def test_no_current_folder_is_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    """A relative folder for caches is not used: anybody's code could be in it."""
    monkeypatch.setenv("XDG_CACHE_HOME", "cache")
    assert all(map(os.path.isabs, extension_modules.parent_folders()))
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)  # a user without a home
    assert all(map(os.path.isabs, extension_modules.parent_folders()))


def no_compiler(folder: Path) -> dict[str, str]:
    """Neither the configured C compiler nor its default."""
    return {"CC": str(folder / "no-such-compiler")}


def blank_compiler(_folder: Path) -> dict[str, str]:
    """A setting that names none."""
    return {"CC": "  "}


def failing_compiler(folder: Path) -> dict[str, str]:
    """A C compiler that rejects each file, below a folder with settings of mypy."""
    (folder / "mypy.ini").write_text("[mypy]\nplugins = no_such_plugin\n")
    script = folder / "c c"
    script.write_text("#!/bin/sh\necho 'fatal error: no space' >&2\nexit 1\n")
    script.chmod(0o755)
    return {"CC": f"'{script}'"}


@pytest.fixture
def headers(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    """A machine that has Python's headers."""
    include = tmp_path_factory.mktemp("include")
    (include / "Python.h").touch()
    monkeypatch.setattr(sysconfig, "get_path", lambda _: str(include))


@pytest.mark.usefixtures("headers")
@pytest.mark.skipif(os.name == "nt", reason="the compiler is a shell script")
@pytest.mark.parametrize(
    ("compiler", "message"),
    [
        (no_compiler, "Expected the C compiler"),
        (blank_compiler, "Expected the C compiler '  ', found none"),
        pytest.param(failing_compiler, "fatal error: no space", marks=pytest.mark.process),
    ],
)
def test_a_compiler_that_is_missing_or_fails(
    compiler: Callable[[Path], dict[str, str]],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    """One line, exit code 2, and nothing is left behind."""
    pytest.importorskip("mypyc")
    parent = tmp_path / "cache"
    monkeypatch.setattr(extension_modules, "parent_folders", lambda: iter([str(parent)]))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    for name, value in compiler(tmp_path).items():
        monkeypatch.setenv(name, value)
    result = shell(monkeypatch, capsys)("compile")
    assert result.code == 2
    assert message in result.err.splitlines()[-1]
    assert not parent.exists()


@pytest.mark.usefixtures("headers")
def test_no_room_to_compile(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The message names the variable with another folder."""
    pytest.importorskip("mypyc")
    monkeypatch.setenv("CC", sys.executable)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "missing"))
    with pytest.raises(IslandError, match=r"found: .*No such file .* TMPDIR"):
        extension_build.build_extensions()


@pytest.mark.usefixtures("headers")
def test_sources_change_during_compilation(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The folder has the name of the sources that were compiled, so it is not used."""
    pytest.importorskip("mypyc")
    package = tmp_path / "islandgp"
    shutil.copytree(resource("islandgp"), package, ignore=shutil.ignore_patterns("__pycache__"))
    before = extension_modules.folder_name(str(package))

    def change_and_compile(_command: list[str], build: str) -> None:
        with (package / "bt" / "core" / "node.py").open("a") as source:
            source.write("# changed\n")
        for file in extension_modules.compiled_files(os.path.join(build, "lib")).values():
            Path(file).parent.mkdir(parents=True, exist_ok=True)
            Path(file).touch()

    monkeypatch.setenv("CC", sys.executable)
    monkeypatch.setattr(extension_modules, "PACKAGE", str(package))
    monkeypatch.setattr(extension_build, "_run", change_and_compile)
    assert extension_build.build_extensions() == str(package / "__pycache__" / before)
    assert extension_modules.folder_name(str(package)) != before


def test_modules_of_another_machine_are_compiled_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Those in a home of several machines, which this one cannot import."""
    pytest.importorskip("mypyc")
    monkeypatch.setenv("CC", str(tmp_path / "no-such-compiler"))
    monkeypatch.setattr(extension_modules, "compiled_folder", lambda: str(tmp_path))
    monkeypatch.setenv("ISLANDGP_EXTENSIONS", "0")
    assert "already compiled" in shell(monkeypatch, capsys)("compile").out
    monkeypatch.delenv("ISLANDGP_EXTENSIONS")
    monkeypatch.delitem(sys.modules, LIBRARY, raising=False)
    assert "Expected the C compiler" in shell(monkeypatch, capsys)("compile").err


def test_mypy_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    """The message names the extra that has it."""
    monkeypatch.setattr(extension_build, "find_spec", lambda _: None)
    with pytest.raises(IslandError, match=r"pip install 'islandgp\[fast\]'"):
        extension_build.build_extensions()


def test_headers_are_missing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The message names the missing file."""
    pytest.importorskip("mypyc")
    monkeypatch.setenv("CC", sys.executable)
    monkeypatch.setattr(sysconfig, "get_path", lambda _: str(tmp_path))
    with pytest.raises(IslandError, match="Python's headers, found no"):
        extension_build.build_extensions()
