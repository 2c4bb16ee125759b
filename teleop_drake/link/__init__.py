"""The loop over a real network: two processes, cut at the channels."""
