"""Where the time of a 17-state trip goes, at one tolerance (rtol 0.01) and the same steps.

As for 12 states.
"""

from __future__ import annotations

from trips import shares

globals().update(shares("one_dimensional"))
