"""The parts that are specific to the 2012 thesis: figures, claims and errata."""
