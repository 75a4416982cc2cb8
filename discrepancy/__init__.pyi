from .conclusion.conclusion import Conclusion
from .effects.effect import Effect
from .effects.kinds import Kind, KindText, register
from .problem.problem import Problem, make_experiments
from .questions.compare import Comparison, SignalComparison, compare
from .questions.locate import WhereItFails, locate
from .questions.next_measurement import compare_trips
from .questions.trip_plan import TripPlan
from .report.diagnosis_json import to_diagnosis
from .report.schema import check_diagnosis
from .report.write import write_report
from .search.decision import Decision
from .stages.stage import AcceptedEffect, RivalExplanation, Stage
from .study.history import restore, save_history
from .study.study import Study

__all__ = [
    "AcceptedEffect",
    "Comparison",
    "Conclusion",
    "Decision",
    "Effect",
    "Kind",
    "KindText",
    "Problem",
    "RivalExplanation",
    "SignalComparison",
    "Stage",
    "Study",
    "TripPlan",
    "WhereItFails",
    "check_diagnosis",
    "compare",
    "compare_trips",
    "locate",
    "make_experiments",
    "register",
    "restore",
    "save_history",
    "to_diagnosis",
    "write_report",
]
