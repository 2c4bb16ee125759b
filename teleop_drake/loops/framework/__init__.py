"""What all rooms share: numbers, names, Contexts, recordings and checks."""
