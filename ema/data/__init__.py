"""Data types: frozen dataclasses over numpy; no algorithms, no files, no plots."""

from ema.arguments import checked
from ema.data.amplitude import AmplitudeDependentMode, AmplitudePrediction, Band, LawParameter, SteppedLevel
from ema.data.beam import BeamModel, Damping, FrictionLaw, Joint, Matrices, NormalContact
from ema.data.campaign import Campaign, Lazy, Repair, Run
from ema.data.comparison import MapComparison, MapPrediction, ModeComparison, ModelUpdate, SignalComparison, Verdict
from ema.data.condition import Condition, Excitation, JointForce
from ema.data.cutting import CuttingLimits
from ema.data.deviations import Deviations
from ema.data.findings import Finding
from ema.data.forced import AmplitudeDraws, ForcedResonances, ForcedResponse, ForceSurface
from ema.data.forecast import Forecast, ForecastCheck
from ema.data.frf import FrfSet
from ema.data.geometry import Geometry
from ema.data.hits import Hit, HitGallery
from ema.data.invariants import check
from ema.data.maps import ModalMap
from ema.data.modal import (
    Candidate,
    ModalModel,
    ModalUncertainty,
    ModeQuality,
    PoleTable,
    Residuals,
    damping_ratios,
    natural_frequencies,
    poles_from,
)
from ema.data.nonlinear_mode import NonlinearMode
from ema.data.placement import (
    BoltedJoint,
    Candidates,
    ControlLine,
    ControlStudy,
    FrictionBeam,
    Place,
    Placement,
    Prediction,
    Ranking,
)
from ema.data.pressure import ContactPressure
from ema.data.provenance import Provenance
from ema.data.recording import Channel, Recording, TakeIdentity
from ema.data.repeats import ConditionDifference, RepeatGroup, VarianceComponents
from ema.data.response import Decay, EnergyBalance, HarmonicResponse, Loop, Response
from ema.data.results import Expectation, LevelEffect, MapResult, RunResult, Statement, StudyResult
from ema.data.set_ups import SetUps, SetUpShifts
from ema.data.single import SingleMode
from ema.data.source import Source
from ema.data.trials import Trial, Trials

__all__ = [
    "AmplitudeDependentMode",
    "AmplitudeDraws",
    "AmplitudePrediction",
    "Band",
    "BeamModel",
    "BoltedJoint",
    "Campaign",
    "Candidate",
    "Candidates",
    "Channel",
    "Condition",
    "ConditionDifference",
    "ContactPressure",
    "ControlLine",
    "ControlStudy",
    "CuttingLimits",
    "Damping",
    "Decay",
    "Deviations",
    "EnergyBalance",
    "Excitation",
    "Expectation",
    "Finding",
    "ForceSurface",
    "ForcedResonances",
    "ForcedResponse",
    "Forecast",
    "ForecastCheck",
    "FrfSet",
    "FrictionBeam",
    "FrictionLaw",
    "Geometry",
    "HarmonicResponse",
    "Hit",
    "HitGallery",
    "Joint",
    "JointForce",
    "LawParameter",
    "Lazy",
    "LevelEffect",
    "Loop",
    "MapComparison",
    "MapPrediction",
    "MapResult",
    "Matrices",
    "ModalMap",
    "ModalModel",
    "ModalUncertainty",
    "ModeComparison",
    "ModeQuality",
    "ModelUpdate",
    "NonlinearMode",
    "NormalContact",
    "Place",
    "Placement",
    "PoleTable",
    "Prediction",
    "Provenance",
    "Ranking",
    "Recording",
    "Repair",
    "RepeatGroup",
    "Residuals",
    "Response",
    "Run",
    "RunResult",
    "SetUpShifts",
    "SetUps",
    "SignalComparison",
    "SingleMode",
    "Source",
    "Statement",
    "SteppedLevel",
    "StudyResult",
    "TakeIdentity",
    "Trial",
    "Trials",
    "VarianceComponents",
    "Verdict",
    "damping_ratios",
    "natural_frequencies",
    "poles_from",
]

for _name in __all__:
    globals()[_name] = checked(globals()[_name], __name__, after=check)
