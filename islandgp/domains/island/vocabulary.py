"""The island's schema: actions, keys, counters and rewarded events (`schema.yaml`)."""

from pathlib import Path
from typing import Final

from islandgp.domain import Schema

SCHEMA: Final = Schema.read(Path(__file__).with_name("schema.yaml"))
VOCABULARY: Final = SCHEMA.vocabulary
