"""stub"""
from pathlib import Path
from islandgp.tracking.store import Store

def parent_run(folder: Path, store: Store) -> str | None:
    return None
