"""Tree files in editors: `islandgp language-server` (README.md)."""
