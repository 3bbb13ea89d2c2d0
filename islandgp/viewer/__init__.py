"""Episodes of trees: recordings, traces and replay pages."""
