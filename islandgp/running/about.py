"""What a run writes down about itself at its start: names, hashes, where it came from."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from time import time
from typing import Any
from uuid import uuid4

from islandgp.config.settings import Settings
from islandgp.records.files import RunMetadata
from islandgp.records.folder import RunFolder
from islandgp.records.parameters import shape
from islandgp.version import code_version


def about_run(
    settings: Settings, config: Mapping[str, Any], target: RunFolder, home: Path, command: str
) -> RunMetadata:
    """The same id and start as before, where a run goes on."""
    before = target.about()
    shaping = shape(config)
    alike = {key: value for key, value in shaping.items() if key not in {"seed", "name"}}
    return RunMetadata(
        id=before.id if before else uuid4().hex,
        title=target.path.name,
        home=str(home),
        command=command,
        started=before.started if before else int(1000 * time()),
        identity=_hash(shaping),
        tags={
            **{name: str(value) for name, value in settings.tags.items()},
            "domain": settings.make_domain().schema.vocabulary.domain,
            "supervisor": settings.supervisor.name,
            "arm": settings.supervisor.name,  # in a sweep its arm there, once that is known
            "seed": str(settings.seed),
            "sweep": settings.name,
            "code": code_version(),
            "config": _hash(alike),  # the same for all seeds
        },
    )


def _hash(config: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(config, sort_keys=True).encode()).hexdigest()[:12]
