from .files.errors import GearError
from .files.geometry import GearPair
from .files.operating_condition import OperatingCondition
from .files.parameters import StageParameters, hertz_stiffness
from .parts.housing_modes import ModeSet, read_modes, rigid_modes, write_modes
from .rig.dataset import DatasetPlan, write_dataset
from .rig.rig import GearRig
from .signals.orders import synchronous_average
from .signals.recording_analysis import RecordingAnalysis, analyse
from .signals.recordings import Recording
from .signals.signal import Signal
from .signals.similarity import cosine, similarity
from .signals.spectrum import spectrum
from .stage.faults import FAULTS, Fault, combined, fault
from .stage.model import Structure
from .stage.stage import GearStage, simulate
from .updating.chain import UpdatingChain
from .updating.command import update
from .updating.result import UpdatingResult
from .updating.settings import UpdatingSettings

__all__ = [
    "FAULTS",
    "DatasetPlan",
    "Fault",
    "GearError",
    "GearPair",
    "GearRig",
    "GearStage",
    "ModeSet",
    "OperatingCondition",
    "Recording",
    "RecordingAnalysis",
    "Signal",
    "StageParameters",
    "Structure",
    "UpdatingChain",
    "UpdatingResult",
    "UpdatingSettings",
    "analyse",
    "combined",
    "cosine",
    "fault",
    "hertz_stiffness",
    "read_modes",
    "rigid_modes",
    "similarity",
    "simulate",
    "spectrum",
    "synchronous_average",
    "update",
    "write_dataset",
    "write_modes",
]

MOVED: dict[str, str]
