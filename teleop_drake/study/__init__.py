"""What is done with runs: sweeps, analyses, figures and links."""
