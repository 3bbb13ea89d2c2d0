"""What a tree does in an episode: recorded, traced, and shown as a page to watch."""
