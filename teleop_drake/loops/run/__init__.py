"""Runs of Systems, compiled or in Drake's Simulator, and their recordings."""
