"""ArviZ before and since version 1: InferenceData, or xarray's DataTree.

The only module that imports ArviZ, which takes seconds: it is imported where it is
used.
"""

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..interfaces import Floats

# Groups whose draws may have weights.
SAMPLED = {"posterior", "sample_stats", "log_likelihood", "response"}
SAMPLED |= {"posterior_predictive"}
FEWEST_RESAMPLED, COPIES = 4_000, 40


def load_arviz() -> Any:
    """Import ArviZ; version 0.23 announces version 1, which is not the user's task."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "[\\s\\S]*ArviZ", FutureWarning)
        import arviz

    return arviz


def wrap(datasets: Mapping[str, Any]) -> Any:
    """Return xarray Datasets as the installed ArviZ's own container."""
    import xarray

    arviz = load_arviz()
    if int(arviz.__version__.split(".")[0]) < 1:
        return arviz.InferenceData(**datasets)
    return xarray.DataTree.from_dict(dict(datasets))


def dataset(idata: Any, group: str) -> Any:
    """Return a group as an xarray Dataset, whatever ArviZ made of it.

    Weighted draws, which :func:`certify` makes, are repeated as their weights say:
    what reads a group here shows the corrected posterior.

    Raises:
        TypeError: If idata is not what :func:`to_inference_data` returns.
        ValueError: If it lacks the group.
    """
    if not hasattr(idata, "children") and not hasattr(idata, "groups"):
        raise TypeError(
            "idata: expected what to_inference_data returns, got "
            f"{type(idata).__name__}"
        )
    try:
        found = _group(idata, group)
    except KeyError:
        raise ValueError(f"idata: it has no group {group!r}") from None
    if group in SAMPLED and is_weighted(idata):
        weights = _group(idata, "sample_stats")["weight"].values.ravel()
        found = found.isel(draw=_resample(weights))
    return found


def groups(idata: Any) -> dict[str, Any]:
    """Return all groups as xarray Datasets."""
    tree = hasattr(idata, "children")
    names = list(idata.children) if tree else [*idata.groups()]
    return {name: _group(idata, name) for name in names}


def describe_certificate(idata: Any) -> str:
    """Return what :func:`certify` said, as a title has it; an empty string without."""
    text = dataset(idata, "posterior").attrs.get("certificate", "")
    return f" ({text})" if text else ""


def _group(idata: Any, group: str) -> Any:
    found = idata[group]
    return found.to_dataset() if hasattr(found, "to_dataset") else found


def is_weighted(idata: Any) -> bool:
    """Return whether the draws have weights, as :func:`certify` gives them."""
    try:
        return "weight" in _group(idata, "sample_stats")
    except KeyError:  # of draws from elsewhere
        return False


def _resample(weights: Floats) -> NDArray[np.intp]:
    """Return draws as often as their weights say, so often that rounding is none."""
    n = len(weights)
    size = max(FEWEST_RESAMPLED, COPIES * n)
    edges = np.cumsum(weights)
    places = (np.arange(size) + 0.5) / size * edges[-1]
    kept: NDArray[np.intp] = np.searchsorted(edges, places, side="right")
    return np.minimum(kept, n - 1)


def samples(
    idata: Any, var_names: Sequence[str] | None = None
) -> tuple[list[str], Floats]:
    """Return names and draws ``(chains, draws, d)`` of the posterior.

    Args:
        idata: What :func:`to_inference_data` returns.
        var_names: Which; None for the sampled parameters. Derived quantities that were
            added to the group must be numbers.

    Raises:
        ValueError: If the group has no such variable, or one has more dimensions.
    """
    posterior = dataset(idata, "posterior")
    wanted: Any = [var_names] if isinstance(var_names, str) else var_names
    if var_names is None:
        wanted = np.atleast_1d(posterior.attrs.get("sampled", list(posterior)))
    names = list(checks.parameter_names("var_names", wanted))
    for name in names:
        if name not in posterior or set(posterior[name].dims) != {"chain", "draw"}:
            raise ValueError(
                f"var_names: expected numbers of the posterior group, got {name!r}; "
                f"there are {[str(n) for n in posterior.data_vars]}"
            )
    ordered = [posterior[name].transpose("chain", "draw").values for name in names]
    return names, np.stack(ordered, axis=-1)


def rhat(chains: Floats) -> Floats:
    """Return the rank-normalised split R-hat of ``chains (m, n, d)``, ``(d,)``."""
    return _by_parameter(load_arviz().rhat, chains)


def effective_sizes(chains: Floats) -> tuple[Floats, Floats]:
    """Return bulk and tail (5 %, 95 %) ESS of ``chains (m, n, d)``, each ``(d,)``."""
    ess = load_arviz().ess
    bulk = _by_parameter(ess, chains, method="bulk")
    # The quantiles are named because their default differs between ArviZ 0.x and 1.x.
    tail = _by_parameter(ess, chains, method="tail", prob=(0.05, 0.95))
    return bulk, tail


def mean_sizes(chains: Floats) -> Floats:
    """Return the ESS of the mean of ``chains (m, n, d)``, ``(d,)``."""
    return _by_parameter(load_arviz().ess, chains, method="mean")


def _by_parameter(statistic: Any, chains: Floats, **options: Any) -> Floats:
    import xarray

    data = {
        f"p{i}": (("chain", "draw"), chains[:, :, i]) for i in range(chains.shape[2])
    }
    # Walkers that never move make ArviZ divide by zero; diagnose names them.
    with np.errstate(divide="ignore", invalid="ignore"):
        result = statistic(
            xarray.Dataset(data, attrs={"sample_dims": ["chain", "draw"]}), **options
        )
    return np.array([float(result[f"p{i}"]) for i in range(chains.shape[2])])
