"""The communication between the stations."""
