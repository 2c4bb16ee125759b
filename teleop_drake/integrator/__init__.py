"""Integration of systems with delays, modes and events by Dormand-Prince 5(4)."""
