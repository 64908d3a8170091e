"""Bayesian updating of finite element models with emcee, stage by stage.

checks        what users get wrong, checked once at the border
contracts     what a user may implement: model, response, term, prior, move
table         tables that print themselves
measurements  what was measured: frequencies, mode shapes and their scatter, from
              arrays, repeats, CSV, universal files and pyOMA2
models        parameters -> response: natural frequencies and mode shapes, or others;
              paired with the measured modes
likelihoods   response -> log-likelihood
posterior     models + terms + prior, for a batch of walkers
evaluation    what solves, stores and counts; failed solves, pools, files
moves         proposals: plain emcee moves
search        find the maxima, fit a proposal to them; anneal a population
verdict       judge chains: their numbers, and what speaks against them
sampling      run emcee: starts, seeds, independent ensembles
results       emcee -> ArviZ; diagnostics, evidence, tables, what the data say
figures       by what they show
extensions    subjects that few need, each on the stages above and on none other:
              frame (with the structures of the paper), fe_programs, emulation,
              reduction, frf, tempering, population, comparison, report
"""

from importlib import import_module
from importlib.metadata import version as _version
from typing import TYPE_CHECKING, Any

from . import moves as moves
from .contracts import ModalSolution as ModalSolution
from .contracts import Variable as Variable
from .contracts import modal_variables as modal_variables
from .evaluation.pools import EvaluationPool as EvaluationPool
from .likelihoods.displacement import DisplacementTerm as DisplacementTerm
from .likelihoods.frequency import FrequencyTerm as FrequencyTerm
from .likelihoods.shape import ShapeTerm as ShapeTerm
from .measurements import Measurements as Measurements
from .models.assembled import AssembledModel as AssembledModel
from .models.function import FunctionModel as FunctionModel
from .models.geometry import Geometry as Geometry
from .models.mass_spring import MassSpringModel as MassSpringModel
from .models.matrix import MatrixModel as MatrixModel
from .models.matrix import StaticModel as StaticModel
from .models.paired import PairedModel as PairedModel
from .moves import DEMCMove as DEMCMove
from .moves import IndependenceMove as IndependenceMove
from .moves import MetropolisMove as MetropolisMove
from .posterior.log_posterior import LogPosterior as LogPosterior
from .posterior.priors import GaussianPrior as GaussianPrior
from .posterior.priors import IndependentPrior as IndependentPrior
from .results.check_test import check_test as check_test
from .results.diagnose import diagnose as diagnose
from .results.evidence import log_evidence as log_evidence
from .results.identifiability import identifiability as identifiability
from .results.tables import frequency_table as frequency_table
from .results.tables import pairing_table as pairing_table
from .results.tables import parameter_table as parameter_table
from .results.tables import predictive_table as predictive_table
from .results.to_arviz import to_inference_data as to_inference_data
from .sampling.run import run as run
from .search.anneal import anneal as anneal
from .search.find_map import find_map as find_map

if TYPE_CHECKING:  # imported when first asked for
    from . import figures as figures
    from .extensions import frf as frf
    from .extensions import population as population
    from .extensions.comparison.classes import compare_models as compare_models
    from .extensions.comparison.compare import compare_moves as compare_moves
    from .extensions.emulation.certify import certify as certify
    from .extensions.emulation.emulate import emulate as emulate
    from .extensions.emulation.run_emulated import run_emulated as run_emulated
    from .extensions.fe_programs.matrices import read_matrices as read_matrices
    from .extensions.fe_programs.opensees import from_opensees as from_opensees
    from .extensions.fe_programs.pynite import from_pynite as from_pynite
    from .extensions.fe_programs.skfem import from_skfem as from_skfem
    from .extensions.frame import paper as paper
    from .extensions.frame.frame import FrameModel as FrameModel
    from .extensions.frame.sections import Section as Section
    from .extensions.population.pool_tests import pool_tests as pool_tests
    from .extensions.reduction.reduced import reduce_model as reduce_model
    from .extensions.report.report import report as report

__version__ = _version("emcee-femu")
IMPORTED_LATER = {  # where these names are
    "figures": "figures",
    "frf": "extensions.frf",
    "paper": "extensions.frame.paper",
    "population": "extensions.population",
    "compare_models": "extensions.comparison.classes",
    "compare_moves": "extensions.comparison.compare",
    "certify": "extensions.emulation.certify",
    "emulate": "extensions.emulation.emulate",
    "run_emulated": "extensions.emulation.run_emulated",
    "read_matrices": "extensions.fe_programs.matrices",
    "from_opensees": "extensions.fe_programs.opensees",
    "from_pynite": "extensions.fe_programs.pynite",
    "from_skfem": "extensions.fe_programs.skfem",
    "FrameModel": "extensions.frame.frame",
    "Section": "extensions.frame.sections",
    "pool_tests": "extensions.population.pool_tests",
    "reduce_model": "extensions.reduction.reduced",
    "report": "extensions.report.report",
}


def __getattr__(name: str) -> Any:
    """Import an extension, or a name of one, when it is first asked for."""
    if name not in IMPORTED_LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = import_module(f".{IMPORTED_LATER[name]}", __name__)
    value = globals()[name] = vars(module).get(name, module)
    return value


def __dir__() -> list[str]:
    """Return the public names, for completion also those that are imported later."""
    own = (n for n, v in globals().items() if __name__ in getattr(v, "__module__", ""))
    return sorted({*own, *IMPORTED_LATER, "moves", "__version__"})
