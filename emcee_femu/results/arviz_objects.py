"""ArviZ before and since version 1: InferenceData, or xarray's DataTree.

ArviZ takes seconds to import; :func:`.load_arviz` imports it when it is first needed.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from .. import checks
from ..contracts import Floats, read_declared
from ..search.importance import resample
from ..verdict.statistics import load_arviz

InferenceData: TypeAlias = Any  # before version 1 its own class, since then a DataTree
Dataset: TypeAlias = Any  # xarray's

# Attributes of the posterior group that any extension may set. The note stands in the
# titles of tables and figures. The group that is named judges the samples as a whole by
# its attributes: `verdict`, a sentence; `refused`; `search` and `evidence` as JSON.
NOTE = "note"
JUDGED_IN = "judged_in"
BEFORE = "certificate"  # both, in objects of version 0.5
# Groups whose draws may have weights.
SAMPLED = {"posterior", "sample_stats", "log_likelihood", "response", "new_measurement"}
FEWEST_RESAMPLED, COPIES = 4_000, 40


class Groups(Mapping[str, Dataset]):
    """The groups of an ArviZ object, each made when it is first asked for.

    Args:
        makers: ``{group: function}``; a function that returns None makes no group.
    """

    def __init__(self, makers: Mapping[str, Callable[[], Dataset | None]]) -> None:
        self._makers, self._made = makers, dict[str, Dataset | None]()

    def __getitem__(self, name: str) -> Dataset:
        """Return a group."""
        if name not in self._made:
            self._made[name] = self._makers[name]()
        if self._made[name] is None:
            raise KeyError(name)
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        """Return the names of all groups, which are made for that."""
        return (name for name in self._makers if name in self)

    def __len__(self) -> int:
        """Return how many groups there are."""
        return sum(1 for _ in self)


def is_arviz(source: object) -> bool:
    """Return whether an object is an ArviZ object, or has groups like one."""
    return isinstance(source, Groups) or hasattr(source, "groups")


def samples_of(source: object) -> object:
    """Return the samples that a result holds as ``idata``, or else the source."""
    held = read_declared(source, "idata")
    return held if is_arviz(held) else source


def judgement_of(source: object) -> Mapping[str, str]:
    """Return the judgement of samples as a whole by what made them, empty if none."""
    held: InferenceData = samples_of(source)
    if not is_arviz(held) or "posterior" not in held:
        return {}
    name = _group(held, "posterior").attrs.get(JUDGED_IN, BEFORE)
    return _group(held, name).attrs if name in held else {}


def wrap(datasets: Mapping[str, Dataset]) -> InferenceData:
    """Return xarray Datasets as the installed ArviZ's own container."""
    import xarray

    arviz = load_arviz()
    if int(arviz.__version__.split(".")[0]) < 1:
        return arviz.InferenceData(**datasets)
    return xarray.DataTree.from_dict(dict(datasets))


def dataset(idata: InferenceData, group: str) -> Dataset:
    """Return a group as an xarray Dataset, for any version of ArviZ.

    Weighted draws are repeated in proportion to their weights.

    Raises:
        TypeError: If idata is not what :func:`to_inference_data` returns.
        ValueError: If it lacks the group.
    """
    if not is_arviz(idata):
        got = type(idata).__name__
        raise TypeError(f"idata: expected what to_inference_data returns, got {got}")
    try:
        values = _group(idata, group)
    except KeyError:
        if group == "response" and "constant_data" in idata:
            return _group(idata, "constant_data")[[]]  # for a bare log-likelihood
        raise ValueError(
            f"idata: it has no group {group!r}, for it was made without the posterior, "
            "as by arviz.from_emcee; convert the samplers with "
            "to_inference_data(samplers, posterior)"
        ) from None
    if group in SAMPLED and is_weighted(idata):
        weights = _group(idata, "sample_stats")["weight"].values.ravel()
        size = max(FEWEST_RESAMPLED, COPIES * len(weights))
        # So many copies that rounding does not matter.
        values = values.isel(draw=resample(weights, size, 0.5))
    return values


def prior_constants(idata: InferenceData, names: Sequence[str]) -> Dataset:
    """Return the known constants of the prior, NaN if unknown."""
    import xarray

    try:
        return dataset(idata, "constant_data").reindex(parameter=list(names))
    except ValueError:  # chains from elsewhere
        nothing = "parameter", np.full(len(names), np.nan)
        constants = ("lower", "upper", "initial", "prior_mean", "prior_sd")
        return xarray.Dataset(dict.fromkeys(constants, nothing))


def prior_draws(idata: InferenceData, names: Sequence[str]) -> Floats:
    """Return draws of the prior ``(n, d)``; NaN for names without a prior."""
    prior = _group(idata, "prior") if "prior" in idata else None
    if prior is None or not prior.sizes["chain"]:  # chains were selected
        return np.full((1, len(names)), np.nan)
    return np.asarray(prior.to_dataframe().reindex(columns=list(names)))


def groups(idata: InferenceData) -> dict[str, Dataset]:
    """Return all groups as xarray Datasets."""
    return {name: _group(idata, name) for name in idata}


def note_of(idata: InferenceData) -> str:
    """Return the note on the samples, for a title; empty if there is none."""
    attributes = dataset(idata, "posterior").attrs
    return str(attributes.get(NOTE, attributes.get(BEFORE, "")))


def in_brackets(note: str) -> str:
    """Return a note as it follows a title, empty if there is none."""
    return f" ({note})" if note else ""


def _group(idata: InferenceData, group: str) -> Dataset:
    values = idata[group]
    return values.to_dataset() if hasattr(values, "to_dataset") else values


def is_weighted(idata: InferenceData) -> bool:
    """Return whether the draws have weights."""
    return str(_group(idata, "posterior").attrs.get("kind")) == "weighted"


def samples(
    idata: InferenceData, var_names: Sequence[str] | None = None
) -> tuple[list[str], Floats]:
    """Return names and draws ``(chains, draws, d)`` of the posterior.

    Args:
        idata: What :func:`to_inference_data` returns.
        var_names: Which, of derived quantities that were added to the group too; None
            for the sampled parameters. Vectors, as ``arviz.from_emcee`` may hold, are
            columns ``x[0]``, ``x[1]``, ...

    Raises:
        ValueError: If the group has no such variable.
    """
    posterior = dataset(idata, "posterior")
    known = posterior.attrs.get("sampled", list(posterior))
    wanted = np.atleast_1d(known if var_names is None else var_names)
    columns: dict[str, Floats] = {}
    for name in checks.parameter_names("var_names", wanted):
        if name not in posterior:
            raise ValueError(
                f"var_names: expected some of the posterior group, got {name!r}; there "
                f"are {[str(n) for n in posterior.data_vars]}"
            )
        values = posterior[name].transpose("chain", "draw", ...).values
        for place in np.ndindex(values.shape[2:]):
            label = f"{name}[{', '.join(map(str, place))}]" if place else name
            columns[label] = values[:, :, *place]
    return list(columns), np.stack([*columns.values()], axis=-1)


def unit_of(idata: InferenceData, name: str) -> str:
    """Return the unit of a variable of the posterior; empty if it has none.

    xarray hands the unit of a parameter on to all that is computed from it, ratios too:
    a derived quantity has a unit only if it is none of those of the parameters.
    """
    posterior = _group(idata, "posterior")
    units = {n: str(v.attrs.get("units", "")) for n, v in posterior.data_vars.items()}
    sampled = [str(n) for n in np.atleast_1d(posterior.attrs.get("sampled", [name]))]
    unit = units.get(name, "")
    inherited = name not in sampled and unit in {units.get(n) for n in sampled}
    return "" if inherited else unit


def original_name(name: str, known: Iterable[object]) -> str:
    """Return the ``known`` name that a name, perhaps with brackets, stands for."""
    candidates = [str(k) for k in known if f"{name}[".startswith(f"{k}[")]
    return max(candidates, key=len, default=name)
