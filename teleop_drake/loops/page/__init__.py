"""The living diagram: one HTML file in which a block diagram simulates."""
