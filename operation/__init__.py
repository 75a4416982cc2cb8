"""The twin in operation: new records judged as they come, over months, for one machine or a fleet.

`Follower` judges records and keeps what it finds in a `Store`; `watch` says of a history what has changed;
`follow_fleet` does both for many machines.  The public names stand in ``__init__.pyi`` and are imported on first use.
Takes from `discrepancy`, `estimation` and `multibody`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
