"""The 37-state trip with stiff parameters (1 kHz current loop, ropes and contact ten times as stiff), equal error."""

from __future__ import annotations

from trips import entries

_usual, _stiff = entries("reference", others=False), entries("reference", stiff=True, others=False)
bench_usual = next(e for e in _usual.values() if str(e.__doc__).startswith("solve_ivp, default"))
bench_usual.__doc__ = "default method, usual parameters"
globals().update({f"bench_stiff_{k}": v for k, v in enumerate(_stiff.values())})
