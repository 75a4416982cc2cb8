"""Where the time of a 12-state trip goes, at one tolerance (rtol 0.01) and the same steps.

Preparation is what `solve_ivp` and the method do in Python whatever the trip: SciPy's own part, tolerances, workspace,
addresses. Samples are the difference between a row and the one after it.
"""

from __future__ import annotations

from trips import shares

globals().update(shares("cabin"))
