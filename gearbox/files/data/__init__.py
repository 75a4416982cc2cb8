"""Parameter and mode files that ship with the gear stage."""
