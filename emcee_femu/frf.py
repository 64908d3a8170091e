"""Frequency response functions: measurements, model, likelihood and figure."""

from .figures.frf import plot_frf as plot_frf
from .likelihoods.frf import FRFTerm as FRFTerm
from .measurements.frf import FRFMeasurements as FRFMeasurements
from .models.frf import FRFModel as FRFModel
