"""The pages of the site, and in ``generate`` the command that writes those of them that come from the code."""
