"""`search=plans`: racing with plans of actions that are learned from the episodes."""
