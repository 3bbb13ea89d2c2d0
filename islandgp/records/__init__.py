"""The files of a run: its folder, checkpoints and checksums, and the folder of a sweep."""
