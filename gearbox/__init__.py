"""gearbox."""
