"""Components that ship with the modelling core."""

from multibody.library.translation import Damper, ForceSource, Mass, Spring

__all__ = ["Damper", "ForceSource", "Mass", "Spring"]
