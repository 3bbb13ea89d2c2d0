"""Static analysis of trees: simplification, warnings, rules, comparison."""
