from .statistics.control_chart import Change, control_chart
from .statistics.fleet_level import FleetPrior, fleet_prior, outliers, share_level
from .store.judgement import Judgement, Quantity
from .store.store import Event, Store, StoreError

__all__ = [
    "Change",
    "Event",
    "FleetPrior",
    "Judgement",
    "Quantity",
    "Store",
    "StoreError",
    "control_chart",
    "fleet_prior",
    "outliers",
    "share_level",
]
