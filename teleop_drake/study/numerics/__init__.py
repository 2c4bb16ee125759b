"""The mathematics of measured signals, without Drake."""
