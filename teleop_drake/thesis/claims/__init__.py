"""The claims of chapters 3 to 6, each measured on runs and given a verdict."""
