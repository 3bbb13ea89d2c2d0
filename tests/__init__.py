"""The tests of islandgp."""
