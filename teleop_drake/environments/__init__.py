"""What the tool meets."""
