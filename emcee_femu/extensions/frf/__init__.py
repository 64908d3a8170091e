"""Frequency response functions: measurements, model, likelihood and figure."""

from .measurements import FRFMeasurements as FRFMeasurements
from .model import FRFModel as FRFModel
from .term import FRFTerm as FRFTerm
from .term import plot_frf as plot_frf
