"""What is particular to the 2012 thesis: its figures, claims and errata."""
