"""Publish the raw records of a sweep in one compressed file, so that its tables can be recomputed.

    python docs/raw_records.py runs/study7 docs/study/editors/records.tar.xz

Packs what the statistics read: configuration, records with their checksums, summary, and the
version of the code. Pages and figures are left out, as they are drawn from these. The file depends
on nothing but the records: no times, owners or folders of this machine.
"""

from __future__ import annotations

import hashlib
import io
import json
import sys
import tarfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

FILES: Final = (
    "best.bt",
    "config.yaml",
    "costs.jsonl",
    "generations.jsonl",
    "generations.sha256",
    "lineage.csv",
    "summary.json",
)


def files_of(run: Path) -> Iterator[tuple[str, bytes]]:
    """The files of a run that are packed, with their contents."""
    about = json.loads((run / "about.json").read_bytes())
    contents = {name: (run / name).read_bytes() for name in FILES}
    contents["about.json"] = json.dumps({**about, "home": "."}, indent=1).encode()
    manifest = {
        name: {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
        for name, data in contents.items()
    }
    contents["manifest.json"] = json.dumps({"files": manifest}, indent=1).encode()
    yield from sorted(contents.items())


def pack(sweep: Path, target: Path) -> int:
    """Pack the finished runs of a sweep's folder; returns their number.

    Raises:
        SystemExit: the folder has no finished run.
    """
    runs = sorted(path.parent for path in sweep.glob("*/summary.json"))
    if not runs:
        raise SystemExit(f"{sweep}: expected the folder of a sweep, found no finished run in it")
    target.parent.mkdir(parents=True, exist_ok=True)
    part = target.with_name(target.name + ".part")
    with tarfile.open(part, "w:xz", preset=9) as archive:
        for run in runs:
            for name, data in files_of(run):
                entry = tarfile.TarInfo(f"{sweep.name}/{run.name}/{name}")
                entry.size = len(data)
                archive.addfile(entry, io.BytesIO(data))
    part.replace(target)
    return len(runs)


def main(arguments: list[str]) -> None:
    """Pack, and print the checksum of the file."""
    if len(arguments) != 2:
        raise SystemExit(__doc__)
    sweep, target = map(Path, arguments)
    runs = pack(sweep, target)
    print(f"{hashlib.sha256(target.read_bytes()).hexdigest()}  {target.name} ({runs} runs)")


if __name__ == "__main__":
    main(sys.argv[1:])
