"""Surrogates for expensive models: sampling plans, sensitivity, polynomial response surfaces, optimisation.

Nothing here knows what the model is: a function takes parameter values and returns one number (a similarity,
a misfit, an output), and a :class:`DesignSpace` names the parameters with their units and bounds.
The public names stand in ``__init__.pyi`` and are imported on first use.  Takes from nobody.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
