"""vtsdt."""
