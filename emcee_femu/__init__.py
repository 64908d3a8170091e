"""Bayesian updating of finite element models with emcee, stage by stage.

interfaces    the contracts that a user may implement
checks        what users get wrong, checked once at the border
table         tables that print themselves
measurements  what was measured: frequencies, mode shapes and their scatter, from
              arrays, repeats, CSV, universal files and pyOMA2
models        parameters -> response: natural frequencies and mode shapes, or others;
              paired with the measured modes; matrices that FE programs export
surrogates    a cheap stand-in for a model, with a certificate
likelihoods   response -> log-likelihood
posterior     models + terms + prior, for a batch of walkers; failed solves
moves         proposals: plain emcee moves
sampling      run emcee: starts, seeds, independent ensembles, files, pools; anneal a
              population (TMCMC)
results       emcee -> ArviZ; diagnostics, evidence, tables, what the data say;
              certify an emulated posterior by full solves
population    many tests of one structure: what they share, and how they differ
comparison    one posterior under several moves; model classes by their evidence
figures       one figure per file
paper         the two structures of the paper, and its published numbers
"""

from importlib.metadata import version as _version

from . import paper as paper
from .comparison.classes import compare_models as compare_models
from .comparison.compare import compare_moves as compare_moves
from .figures import plot_comparison as plot_comparison
from .figures import plot_correlation as plot_correlation
from .figures import plot_frf as plot_frf
from .figures import plot_model_comparison as plot_model_comparison
from .figures import plot_population as plot_population
from .figures import plot_predictive as plot_predictive
from .figures import plot_scatter as plot_scatter
from .figures import plot_tae as plot_tae
from .interfaces import ModalSolution as ModalSolution
from .interfaces import PairedSolution as PairedSolution
from .interfaces import Variable as Variable
from .interfaces import modal_variables as modal_variables
from .likelihoods.displacement import DisplacementTerm as DisplacementTerm
from .likelihoods.frequency import FrequencyTerm as FrequencyTerm
from .likelihoods.frf import FRFTerm as FRFTerm
from .likelihoods.shape import ShapeTerm as ShapeTerm
from .likelihoods.spectrum import SpectrumTerm as SpectrumTerm
from .measurements import Measurements as Measurements
from .measurements.frf import FRFMeasurements as FRFMeasurements
from .measurements.spectra import Spectra as Spectra
from .models.exports.read import read_matrices as read_matrices
from .models.exports.record import Matrices as Matrices
from .models.frame.model import FrameModel as FrameModel
from .models.frame.section import Section as Section
from .models.frf import FRFModel as FRFModel
from .models.function import FunctionModel as FunctionModel
from .models.mass_spring import MassSpringModel as MassSpringModel
from .models.matrix import MatrixModel as MatrixModel
from .models.paired import PairedModel as PairedModel
from .models.spectrum import SpectrumModel as SpectrumModel
from .models.static import StaticModel as StaticModel
from .moves import CrossoverMove as CrossoverMove
from .moves import DelayedAcceptanceMove as DelayedAcceptanceMove
from .moves import DEMCMove as DEMCMove
from .moves import HamiltonianMove as HamiltonianMove
from .moves import IndependenceMove as IndependenceMove
from .moves import MetropolisMove as MetropolisMove
from .moves import SnookerMove as SnookerMove
from .moves import TemperedMove as TemperedMove
from .population.normal import NormalPopulation as NormalPopulation
from .population.pool_tests import pool_tests as pool_tests
from .posterior.log_posterior import LogPosterior as LogPosterior
from .posterior.priors import GaussianPrior as GaussianPrior
from .posterior.priors import IndependentPrior as IndependentPrior
from .posterior.priors import uniform_between as uniform_between
from .results.certify import certify as certify
from .results.diagnostics import diagnose as diagnose
from .results.evidence import log_evidence as log_evidence
from .results.identifiability import identifiability as identifiability
from .results.inference_data import to_inference_data as to_inference_data
from .results.modes_from_spectra import modes_from_spectra as modes_from_spectra
from .results.predictive import pairing_table as pairing_table
from .results.predictive import predictive_table as predictive_table
from .results.tables import frequency_table as frequency_table
from .results.tables import parameter_table as parameter_table
from .sampling.anneal import anneal as anneal
from .sampling.emulate import emulate as emulate
from .sampling.find_map import find_map as find_map
from .sampling.pools.evaluation_pool import EvaluationPool as EvaluationPool
from .sampling.run import run as run
from .surrogates.emulated import EmulatedModel as EmulatedModel
from .surrogates.reduced import ReducedModel as ReducedModel
from .surrogates.ritz_greedy import reduce_model as reduce_model

__version__ = _version("emcee-femu")
