"""Trees in the formats of other tools, and back; docs/exports.md lists the differences."""
