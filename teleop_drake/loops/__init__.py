"""Any Diagram of Drake's, with exact delays."""
