"""Bayesian updating of finite element models with emcee, stage by stage.

interfaces    the contracts that a user may implement
checks        what users get wrong, checked once at the border
table         tables that print themselves
measurements  what was measured: frequencies, mode shapes and their scatter, from
              arrays, repeats, CSV, universal files and pyOMA2
models        parameters -> response: natural frequencies and mode shapes, or others;
              paired with the measured modes
fe_files      matrices that FE programs export
fe_programs   matrices of the model that stands in an FE program
likelihoods   response -> log-likelihood
posterior     models + terms + prior, for a batch of walkers; failed solves
moves         proposals: plain emcee moves
sampling      run emcee: starts, seeds, independent ensembles, files, pools; anneal a
              population (TMCMC)
surrogates    a cheap stand-in for a model: a reduced one, an emulated one
results       emcee -> ArviZ; diagnostics, evidence, tables, what the data say;
              certify an emulated posterior by full solves
population    many tests of one structure: what they share, and how they differ
comparison    one posterior under several moves; model classes by their evidence
figures       one figure per file
reports       what was done and what was learned, in one file to hand over
paper         the two structures of the paper, and its published numbers
"""

from importlib import import_module
from importlib.metadata import version as _version
from types import ModuleType
from typing import TYPE_CHECKING

from . import moves as moves
from .contracts import ModalSolution as ModalSolution
from .contracts import Variable as Variable
from .contracts import modal_variables as modal_variables
from .evaluation.pools import EvaluationPool as EvaluationPool
from .extensions.comparison.classes import compare_models as compare_models
from .extensions.comparison.compare import compare_moves as compare_moves
from .extensions.emulation.certify import certify as certify
from .extensions.emulation.emulate import emulate as emulate
from .extensions.fe_files.matrices import read_matrices as read_matrices
from .extensions.fe_programs.opensees import from_opensees as from_opensees
from .extensions.fe_programs.pynite import from_pynite as from_pynite
from .extensions.fe_programs.skfem import from_skfem as from_skfem
from .extensions.population.pool_tests import pool_tests as pool_tests
from .extensions.reduction.reduced import reduce_model as reduce_model
from .extensions.report.report import report as report
from .likelihoods.displacement import DisplacementTerm as DisplacementTerm
from .likelihoods.frequency import FrequencyTerm as FrequencyTerm
from .likelihoods.shape import ShapeTerm as ShapeTerm
from .measurements import Measurements as Measurements
from .models.assembled import AssembledModel as AssembledModel
from .models.frame import FrameModel as FrameModel
from .models.frame import Section as Section
from .models.function import FunctionModel as FunctionModel
from .models.geometry import Geometry as Geometry
from .models.mass_spring import MassSpringModel as MassSpringModel
from .models.matrix import MatrixModel as MatrixModel
from .models.paired import PairedModel as PairedModel
from .models.static import StaticModel as StaticModel
from .moves import DEMCMove as DEMCMove
from .moves import IndependenceMove as IndependenceMove
from .moves import MetropolisMove as MetropolisMove
from .posterior.log_posterior import LogPosterior as LogPosterior
from .posterior.priors import GaussianPrior as GaussianPrior
from .posterior.priors import IndependentPrior as IndependentPrior
from .results.diagnose import diagnose as diagnose
from .results.evidence import log_evidence as log_evidence
from .results.identifiability import identifiability as identifiability
from .results.tables import frequency_table as frequency_table
from .results.tables import pairing_table as pairing_table
from .results.tables import parameter_table as parameter_table
from .results.tables import predictive_table as predictive_table
from .results.to_arviz import to_inference_data as to_inference_data
from .sampling.anneal import anneal as anneal
from .sampling.find_map import find_map as find_map
from .sampling.run import run as run

if TYPE_CHECKING:
    from . import figures as figures

__version__ = _version("emcee-femu")
LATER = ("figures", "frf", "paper")


def __getattr__(name: str) -> ModuleType:
    """Import a special subject when it is first asked for, as in ``ef.frf``."""
    if name in LATER:
        return import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return all names, for completion also those that are imported later."""
    return [*globals(), *LATER]
