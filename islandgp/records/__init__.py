"""What a run leaves on disk: its folder, checkpoints and checksums, and a sweep's folder."""
