"""The loop over a real network: two processes, separated at the channels."""
