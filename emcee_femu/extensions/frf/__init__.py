"""Frequency response functions: measurements, model, likelihood and figure."""

from .figure import plot_frf as plot_frf
from .measurements import FRFMeasurements as FRFMeasurements
from .model import FRFModel as FRFModel
from .model import FRFTerm as FRFTerm
