"""What can be concluded from a tree without running it: simplify, lint, rules, comparison."""
