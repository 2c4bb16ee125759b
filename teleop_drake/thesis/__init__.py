"""All that is particular to the 2012 thesis: figures, claims and errata."""
