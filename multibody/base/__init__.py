"""What every other room stands on: errors, units, threads, the cache folder, progress."""
