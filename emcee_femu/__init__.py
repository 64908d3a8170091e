"""Bayesian updating of finite element models with emcee, stage by stage.

interfaces       the contracts that a user may implement
failures         solves that fail: why, where, how many
models           parameters -> natural frequencies and mode shapes
measurements     measured frequencies, mode shapes and their scatter, from
                 arrays, repeats, CSV, universal files and pyOMA2
pairing          MAC and one-to-one choices
paired_model     a model in the order of the measured modes
likelihoods      frequencies -> log-likelihood
shape_likelihood mode shapes -> log-likelihood
priors           names, order, bounds and density of the parameters
agreement        whether model, terms and prior fit together
posterior        model + terms + prior, for a batch of walkers
guarded          a posterior that turns failed solves into rejections
pools            ship the posterior once to processes or machines
moves            proposals: plain emcee moves
auto             the recipe "auto": burn in, fit an independence proposal, mix
starts           the first state of every ensemble
fingerprint      what is sampled and how, as text
run_file         a backend that a kill leaves usable
run_start        how a run in a file begins and goes on
run_arguments    what a run is given, checked
sampling         run emcee: starts, seeds, independent ensembles, resume
inference_data   emcee -> ArviZ
diagnostics      tau, ESS, R-hat, acceptance, and a verdict
evidence         of a model class, from tempered samplers
tables           parameters and frequencies as text, Markdown, CSV
information      what the data say of each parameter
predictive       predicted against measured frequencies and MAC, as tables
contest          what each move of a comparison achieved, and who won
comparison       one posterior under several moves, from the same starts
figures          scatter with 95 % ellipses, error curve, correlation map,
                 predictions, efficiency and error of the moves
paper            the two structures of the paper, and its published numbers
"""

from importlib.metadata import version as _version

from . import paper as paper
from .comparison.compare import compare_moves as compare_moves
from .figures import plot_comparison as plot_comparison
from .figures import plot_correlation as plot_correlation
from .figures import plot_predictive as plot_predictive
from .figures import plot_scatter as plot_scatter
from .figures import plot_tae as plot_tae
from .interfaces import ModalSolution as ModalSolution
from .likelihoods.frequency import FrequencyTerm as FrequencyTerm
from .likelihoods.shape import ShapeTerm as ShapeTerm
from .measurements import Measurements as Measurements
from .models.frame.model import FrameModel as FrameModel
from .models.frame.section import Section as Section
from .models.function import FunctionModel as FunctionModel
from .models.mass_spring import MassSpringModel as MassSpringModel
from .models.matrix import MatrixModel as MatrixModel
from .models.paired import PairedModel as PairedModel
from .moves import CrossoverMove as CrossoverMove
from .moves import DelayedAcceptanceMove as DelayedAcceptanceMove
from .moves import DEMCMove as DEMCMove
from .moves import IndependenceMove as IndependenceMove
from .moves import MetropolisMove as MetropolisMove
from .moves import SnookerMove as SnookerMove
from .moves import TemperedMove as TemperedMove
from .posterior.log_posterior import LogPosterior as LogPosterior
from .posterior.priors import GaussianPrior as GaussianPrior
from .posterior.priors import IndependentPrior as IndependentPrior
from .posterior.priors import uniform_between as uniform_between
from .results.diagnostics import diagnose as diagnose
from .results.evidence import log_evidence as log_evidence
from .results.identifiability import identifiability as identifiability
from .results.inference_data import to_inference_data as to_inference_data
from .results.predictive import pairing_table as pairing_table
from .results.predictive import predictive_table as predictive_table
from .results.tables import frequency_table as frequency_table
from .results.tables import parameter_table as parameter_table
from .sampling.pools.evaluation_pool import EvaluationPool as EvaluationPool
from .sampling.run import run as run
from .surrogates.reduced import ReducedModel as ReducedModel
from .surrogates.ritz_greedy import reduce_model as reduce_model

__version__ = _version("emcee-femu")
