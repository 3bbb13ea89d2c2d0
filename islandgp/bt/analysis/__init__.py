"""Static analysis of trees: simplification, warnings, comparison."""
