"""Bayesian updating of finite element models with emcee, stage by stage.

interfaces       the contracts that a user may implement
models           parameters -> natural frequencies and mode shapes
likelihoods      frequencies -> log-likelihood
priors           names, order, bounds and density of the parameters
posterior        model + terms + prior, for a batch of walkers
moves            proposals: plain emcee moves
auto             the recipe "auto": burn in, fit an independence proposal, mix
sampling         run emcee: starts, seeds, independent ensembles
inference_data   emcee -> ArviZ
diagnostics      tau, ESS, R-hat, acceptance, and a verdict
evidence         of a model class, from tempered samplers
tables           parameters and frequencies as text, Markdown, CSV
figures          scatter with 95 % ellipses, error curve, correlation map
contest          what each move of a comparison achieved, and who won
comparison       one posterior under several moves, from the same starts
comparison_figure  efficiency and error of the moves, side by side
paper            the two structures of the paper, and its published numbers
"""

from importlib.metadata import version as _version

from . import paper as paper
from .comparison import compare_moves as compare_moves
from .comparison_figure import plot_comparison as plot_comparison
from .diagnostics import diagnose as diagnose
from .evidence import log_evidence as log_evidence
from .figures import plot_correlation as plot_correlation
from .figures import plot_scatter as plot_scatter
from .figures import plot_tae as plot_tae
from .inference_data import to_inference_data as to_inference_data
from .interfaces import ModalSolution as ModalSolution
from .likelihoods import FrequencyTerm as FrequencyTerm
from .models.affine import MatrixModel as MatrixModel
from .models.frame import FrameModel as FrameModel
from .models.function import FunctionModel as FunctionModel
from .models.mass_spring import MassSpringModel as MassSpringModel
from .models.section import Section as Section
from .moves import CrossoverMove as CrossoverMove
from .moves import DEMCMove as DEMCMove
from .moves import IndependenceMove as IndependenceMove
from .moves import MetropolisMove as MetropolisMove
from .moves import SnookerMove as SnookerMove
from .moves import TemperedMove as TemperedMove
from .posterior import LogPosterior as LogPosterior
from .priors import GaussianPrior as GaussianPrior
from .priors import IndependentPrior as IndependentPrior
from .sampling import run as run
from .tables import frequency_table as frequency_table
from .tables import parameter_table as parameter_table

__version__ = _version("emcee-femu")
