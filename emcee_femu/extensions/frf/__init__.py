"""Frequency response functions: measurements, model, likelihood and figure."""

from .measurements import FRFMeasurements as FRFMeasurements
from .model import FRFModel as FRFModel
from .model import FRFTerm as FRFTerm
from .model import plot_frf as plot_frf
