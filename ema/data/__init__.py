"""Nouns: frozen dataclasses over numpy; no algorithms, no files, no plots."""

from ema.data.campaign import Campaign, Lazy, Repair, Run
from ema.data.condition import Condition, Excitation, JointForce
from ema.data.findings import Finding
from ema.data.frf import FrfSet
from ema.data.geometry import Geometry
from ema.data.hits import Hit, HitGallery
from ema.data.maps import ModalMap
from ema.data.modal import ModalModel, PoleTable, Residuals, damping_ratios, natural_frequencies, poles_from
from ema.data.provenance import Provenance
from ema.data.recording import Channel, Recording
from ema.data.results import Expectation, ModeQuality, RunResult, StudyResult
from ema.data.source import Source

__all__ = [
    "Campaign", "Channel", "Condition", "Excitation", "Expectation", "Finding", "FrfSet", "Geometry", "Hit",
    "HitGallery", "JointForce", "Lazy", "ModalMap", "ModalModel", "ModeQuality", "PoleTable", "Provenance", "Recording",
    "Repair", "Residuals", "Run", "RunResult", "Source", "StudyResult", "damping_ratios", "natural_frequencies",
    "poles_from",
]  # fmt: skip
