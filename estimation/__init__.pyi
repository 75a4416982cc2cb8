from .files.faults import RecordError
from .files.read_records import read_record, read_records
from .files.read_rules import ReadRules
from .files.record import OwnSamples, Record, RecordedSignal
from .fit.calibrate import calibrate, evaluate
from .fit.calibration import Calibration, Fit, UncertainParameter
from .response.experiment import Experiment, Response
from .response.perturbations import InputPerturbation, ParameterPerturbation, PerturbationResponse
from .response.sensors import SensorError
from .signals.metrics import Agreement, NoiseFloor, agreement, noise_floor
from .signals.preparation import Preparation, SignalError

__all__ = [
    "Agreement",
    "Calibration",
    "Experiment",
    "Fit",
    "InputPerturbation",
    "NoiseFloor",
    "OwnSamples",
    "ParameterPerturbation",
    "PerturbationResponse",
    "Preparation",
    "ReadRules",
    "Record",
    "RecordError",
    "RecordedSignal",
    "Response",
    "SensorError",
    "SignalError",
    "UncertainParameter",
    "agreement",
    "calibrate",
    "evaluate",
    "noise_floor",
    "read_record",
    "read_records",
]
