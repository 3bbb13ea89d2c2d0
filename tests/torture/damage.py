"""Files of a run's folder that are damaged: reported in words, or without effect on its records."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Final

from tests.torture.lab import QUICK, SLOW, Lab, assert_refused, communicate, start, under_way

FILES: Final = ("generations.jsonl", "config.yaml", "about.json", "lineage.csv", "summary.json")


def _cut(file: Path) -> None:
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 2])


def _changed(file: Path) -> None:
    """One digit, in the middle or the next one after it, is another one."""
    data = bytearray(file.read_bytes())
    places = [k for k, byte in enumerate(data) if chr(byte).isdigit()]
    at = min(places, key=lambda k: abs(k - len(data) // 2))
    data[at] = ord("1") if data[at] != ord("1") else ord("2")
    file.write_bytes(bytes(data))


def _emptied(file: Path) -> None:
    file.write_bytes(b"")


DAMAGES: Final[tuple[Callable[[Path], None], ...]] = (_cut, _changed, _emptied, Path.unlink)


def finished_run(lab: Lab) -> None:
    """Each file of a finished run damaged in four ways: the same command refuses and names it."""
    home = lab.folder()
    code, output = communicate(start(home, *QUICK))
    assert code == 0, output
    (run,) = (path.parent for path in (home / "runs").rglob("summary.json"))
    for name in FILES:
        for damage in DAMAGES:
            if name == "summary.json" and damage is Path.unlink:
                continue  # it is not finished then, and goes on
            sound = (run / name).read_bytes()
            damage(run / name)
            ending = lab.run(home, *QUICK)
            assert_refused(ending, name)
            (run / name).write_bytes(sound)
    lab.assert_finishes(home, QUICK)


def unfinished_run(lab: Lab) -> None:
    """The files of a run that was killed: the command ends in the same records, or refuses."""
    home = lab.folder()
    process = start(home, *SLOW)
    under_way(home, process)
    process.kill()
    process.communicate()
    for name in ("generations.jsonl", "config.yaml", "about.json", "costs.jsonl"):
        for damage in DAMAGES:
            copy = lab.folder()
            shutil.copytree(home / "runs", copy / "runs")
            (file,) = (copy / "runs").rglob(name)
            damage(file)
            ending = lab.run(copy, *SLOW)
            assert "Traceback" not in ending.output, ending.output
            if ending.code:
                assert_refused(ending)
            else:
                lab.assert_same(copy, SLOW)
