"""One run in many ways: its records are the same bytes, for any workers and restarts."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from tests.running.commands import ROOT
from tests.torture.lab import Lab, Missing, communicate, records, start, under_way

SMALL: Final = ("gp.population=8", "gp.generations=6", "tracking=off", "progress=off", "seed=3")
ISLAND: Final = (*SMALL, "supervisor=expert", "world.episode.length=20")
DOMAINS: Final = {
    "island": ("world.episode.length=20",),
    "minigrid": ("--config-dir", str(ROOT / "examples/minigrid/conf"), "domain=minigrid"),
    "cartpole": ("domain=cartpole",),
    "lunarlander": ("domain=lunarlander",),
    "pick_place": ("--config-dir", str(ROOT / "examples/pick_place/conf"), "domain=pick_place"),
}
PYTHONS: Final = ("3.12", "3.13")


def digest(home: Path) -> str:
    """Of what `records` returns for the run below a folder."""
    files = records(home)
    assert len(files) == 4, sorted(files)
    content = b"".join(files[name] for name in sorted(files, key=lambda n: n.rpartition("/")[2]))
    return hashlib.sha256(content).hexdigest()


def digest_of(lab: Lab, *arguments: str, **options: object) -> str:
    """The digest of a run in a new folder. Raises AssertionError where it fails."""
    home = lab.folder()
    code, output = communicate(start(home, *arguments, **options))  # type: ignore[arg-type] # as `start`
    assert code == 0, output
    lab.cases += 1
    return digest(home)


def worker_counts(lab: Lab) -> None:
    """In the run's own process; in 1, 2 and 4 workers."""
    digests = {digest_of(lab, *ISLAND, "evaluator=serial")}
    digests |= {digest_of(lab, *ISLAND, f"evaluator.policy.workers={n}") for n in (1, 2, 4)}
    assert len(digests) == 1


def hash_seeds(lab: Lab) -> None:
    """PYTHONHASHSEED 0, 1, 12345 and none."""
    seeds = ("0", "1", "12345", "random")
    digests = {
        digest_of(lab, *ISLAND, "evaluator.policy.workers=2", env={"PYTHONHASHSEED": seed})
        for seed in seeds
    }
    assert len(digests) == 1


def resumed(lab: Lab) -> None:
    """Stopped after generation 1, 2, 3 and 4, beside a run that was not."""
    arguments = (*ISLAND, "evaluator.policy.workers=2", "gp.generations=20")
    straight = digest_of(lab, *arguments)
    home = lab.folder()
    for n in range(1, 5):
        process = start(home, *arguments)
        under_way(home, process, n)
        process.terminate()
        code, output = communicate(process)
        assert code == 130, output
        lab.cases += 1
    code, output = communicate(start(home, *arguments))
    assert code == 0, output
    assert digest(home) == straight


def launchers(lab: Lab) -> None:
    """A run alone, in a sweep, in processes, and by submitit where it is installed."""
    digests = {digest_of(lab, *ISLAND), digest_of(lab, *ISLAND, "-m")}
    for name in ("local", *(["slurm_try"] if find_spec("submitit") else [])):
        digests.add(digest_of(lab, *ISLAND, f"hydra/launcher={name}", "-m"))
    assert len(digests) == 1


def ray(lab: Lab) -> None:
    """A run alone, and its episodes on Ray."""
    if not find_spec("ray"):
        raise Missing("Ray is not installed")
    episodes = ("evaluator=ray", "evaluator.policy.address=local", "evaluator.policy.workers=2")
    assert digest_of(lab, *ISLAND) == digest_of(lab, *ISLAND, *episodes)


def domains(lab: Lab) -> None:
    """Each domain in its own process, in 2 workers, and with another PYTHONHASHSEED."""
    path = os.pathsep.join(
        (str(ROOT), *(str(ROOT / "examples" / e) for e in ("pick_place", "minigrid")))
    )
    for name, overrides in DOMAINS.items():
        if name in ("cartpole", "lunarlander") and not find_spec("gymnasium"):
            continue
        if name == "minigrid" and not find_spec("minigrid"):
            continue
        quick = (
            *overrides,
            *SMALL,
            "gp.generations=3",
            "supervisor=baseline",
            "library.folder=null",
        )
        digests = {
            digest_of(lab, *quick, "evaluator=serial", env={"PYTHONPATH": path}),
            digest_of(
                lab,
                *quick,
                "evaluator.policy.workers=2",
                env={"PYTHONPATH": path, "PYTHONHASHSEED": "7"},
            ),
        }
        assert len(digests) == 1, name


def pythons(lab: Lab) -> None:
    """Other versions of Python, where pyenv has them, with the wheel and this one's packages."""
    digests = {digest_of(lab, *ISLAND, "evaluator.policy.workers=2")}
    for version in PYTHONS:
        if (python := other_python(lab, version)) is not None:
            digests.add(run_with(lab, python))
    if lab.cases == 1:
        raise Missing("there is no other Python here")
    assert len(digests) == 1


def other_python(lab: Lab, version: str) -> Path | None:
    """A new environment with the wheel, or None where pyenv lacks the version."""
    places = sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python"))
    if not places:
        return None
    folder = lab.folder()
    subprocess.run([places[-1], "-m", "venv", folder], check=True)
    python = folder / "bin/python"
    options = ["--quiet", "--disable-pip-version-check", "-c", str(ROOT / "constraints.txt")]
    subprocess.run([python, "-m", "pip", "install", *options, wheel(lab)], check=True)
    return python


def run_with(lab: Lab, python: Path) -> str:
    """The digest of the same run by another interpreter, with its own package."""
    home = lab.folder()
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [str(python), "-m", "islandgp", *ISLAND, "evaluator.policy.workers=2"]
    subprocess.run(command, cwd=home, env=env, check=True, capture_output=True)
    lab.cases += 1
    return digest(home)


def wheel(lab: Lab) -> Path:
    """This checkout's wheel."""
    folder = lab.folder()
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    return next(folder.glob("*.whl"))


def installed(lab: Lab) -> None:
    """The wheel in a separate environment, in a folder with a blank, beside the checkout."""
    folder = lab.folder()
    venv.create(folder, with_pip=False, symlinks=True)
    (library,) = folder.glob("lib/python*/site-packages")
    (library / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    python = folder / "bin/python"
    command = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet"]
    options = ["--no-deps", "--no-index", "--disable-pip-version-check"]
    subprocess.run([*command, *options, str(wheel(lab))], check=True)
    assert run_with(lab, python) == digest_of(lab, *ISLAND, "evaluator.policy.workers=2")
    shutil.rmtree(folder)


MATRIX: Final[dict[str, tuple[Callable[[Lab], None], str]]] = {
    "workers": (worker_counts, "in the run's process, 1, 2 and 4 workers"),
    "PYTHONHASHSEED": (hash_seeds, "0, 1, 12345, random"),
    "resumption": (resumed, "straight, and stopped four times"),
    "launcher": (launchers, "alone, in a sweep, in processes, submitit"),
    "Ray": (ray, "without, a job on it, episodes on it"),
    "domain": (domains, f"{', '.join(DOMAINS)}; each without workers and with 2"),
    "wheel": (installed, "the checkout, and the wheel in a separate environment"),
    "Python": (pythons, f"this one's, {', '.join(PYTHONS)} where pyenv has them"),
}
"""What varies: the function that tries it, and its values."""
