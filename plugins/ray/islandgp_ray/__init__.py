"""`evaluator=ray`: episodes on a Ray cluster."""
