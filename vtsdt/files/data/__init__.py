"""Parameter files that ship with the package."""
