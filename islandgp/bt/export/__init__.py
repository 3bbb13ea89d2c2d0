"""Ways out: trees in the forms of other tools, and back. What is lost: docs/exports.md."""
