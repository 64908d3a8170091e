"""How often the statement on the fit is right, of right tests and of wrong ones.

Run it:  python examples/benchmarks/fit_calibration.py   (300 runs, some ten minutes)
         python examples/benchmarks/fit_calibration.py --right 20 --wrong 10 --first 7

Each test is simulated with its own structure, a chain of masses on springs in groups
whose stiffnesses are within 20 % of the model's, and with its own noise. There are five
kinds: frequencies alone; frequencies and shapes, paired, with the error of shapes by
MAC; the same by sensor; deflections under two loads; and FRFs. In every other test the
errors are known, in the others they are inferred.

Of wrong tests one thing is wrong: a gain of one sensor (1.5 to 3, or its inverse), a
sensor turned round, two exchanged, a measured mode that is none of the structure's, or
a sensor in another unit (25.4 or 1000 times too large or small). Only what the data can
tell is asked: with the true stiffnesses the fault must make chi^2 larger by 60, and in
shapes take a MAC below 0.95. It is named rightly if the sensors that are suspected or
else the farthest sensors or points are those that are wrong, or if the spurious mode is
said to resemble none.
"""

import warnings
from typing import NamedTuple

import numpy as np
from commands import command, tabulate
from scipy import stats

import emcee_femu as ef
from emcee_femu.likelihoods.residuals import RESEMBLES_NONE, SUSPECT
from emcee_femu.results.fit import find_farthest

KINDS = "frequencies", "shapes by MAC", "shapes by sensor", "deflections", "FRFs"
FAULTS = "gain", "turned", "exchanged", "spurious mode", "unit"
GROUPS = 3
FREQUENCY_SD, SHAPE_SD, STATIC_SD, FRF_SD = 0.005, 0.01, 0.01, 0.03
ERRORS = {  # the priors of errors that are inferred
    "frequency error": (0.0005, 0.05),
    "shape error": stats.halfnorm(scale=0.1),
    "deflection error": (0.001, 0.2),
    "FRF error": (0.001, 0.5),
}
STATUSES = "fits", "doubtful", "at a bound", "does not fit"
PRIOR = {f"k{i}": stats.lognorm(0.2) for i in range(GROUPS)}
WALKERS, BURN_IN = 20, 100
TOLD = 60.0  # chi^2 of a fault that the data can tell
TOLD_MAC = 0.95
ALIKE = 0.5  # MAC of a spurious mode with those of the structure, at most


class Outcome(NamedTuple):
    """What was simulated, and what was said of it."""

    kind: str
    fault: str
    inferred: bool
    status: str
    named: bool


class Chain:
    """A chain of masses, whose springs are in groups, and the truth."""

    def __init__(self, rng):
        self.n = int(rng.integers(6, 11))
        self.masses = rng.uniform(1.0, 3.0, self.n)
        springs = 1e3 * rng.uniform(0.8, 1.5, self.n)
        groups = {}
        for i, part in enumerate(np.array_split(np.arange(self.n), GROUPS)):
            K = groups[f"k{i}"] = np.zeros((self.n, self.n))
            for j in part:
                K[j, j] += springs[j]
                if j:
                    K[j - 1, j - 1] += springs[j]
                    K[j - 1, j] -= springs[j]
                    K[j, j - 1] -= springs[j]
        self.groups = groups
        drawn = [law.rvs(random_state=rng) for law in PRIOR.values()]
        self.truth = {k: np.array([x]) for k, x in zip(PRIOR, drawn, strict=True)}

    def modal(self, n_modes=None):
        """Return its model, with all modes by default."""
        zero, M = np.zeros((self.n, self.n)), np.diag(self.masses)
        count = self.n if n_modes is None else n_modes
        return ef.MatrixModel(zero, M, self.groups, n_modes=count, shapes=True)


def break_sensor(values, fault, rng):
    """Return values ``(sensors, ...)`` with one fault, and the numbers of the wrong."""
    values, sensors = values.copy(), rng.permutation(len(values))
    one, two = sensors[:2]
    factor = {"gain": rng.uniform(1.5, 3.0), "unit": rng.choice([25.4, 1000.0])}
    if fault == "exchanged":
        values[[one, two]] = values[[two, one]]
        return values, {int(one), int(two)}
    values[one] *= -1 if fault == "turned" else factor[fault] ** rng.choice([-1, 1])
    return values, {int(one)}


def simulate(kind, fault, inferred, rng):
    """Return the posterior of a simulated test, and what is wrong with it."""
    while True:
        chain = Chain(rng)
        build = {0: frequencies, 1: shapes, 2: shapes, 3: deflections, 4: frfs}
        made = build[KINDS.index(kind)](chain, kind, fault, inferred, rng)
        if made is not None:
            break
    model, terms, wrong = made
    errors = {term.discrepancy for term in terms} - {None}
    laws = PRIOR | {name: ERRORS[name] for name in sorted(errors)}
    posterior = ef.LogPosterior(model, terms, ef.IndependentPrior(laws))
    return posterior, chain.truth, wrong


def error_of(name, inferred, **known):
    """Return the argument of an error that is known or inferred."""
    return {"discrepancy": name} if inferred else known


def frequencies(chain, kind, fault, inferred, rng):
    """Simulate six frequencies."""
    model = chain.modal(6)
    hertz = model(chain.truth).frequencies[0]
    hertz = np.sort(hertz * (1 + FREQUENCY_SD * rng.standard_normal(len(hertz))))
    error = error_of("frequency error", inferred, relative_sd=FREQUENCY_SD)
    return model, [ef.FrequencyTerm(hertz, **error)], set()


def shapes(chain, kind, fault, inferred, rng):
    """Simulate four modes, and perhaps a spurious one among them."""
    m, model = 4, chain.modal()
    true = model(chain.truth)
    hertz, exact = true.frequencies[0][:m], true.shapes[0][:, :m]
    exact = exact / np.linalg.norm(exact, axis=0)
    hertz = hertz * (1 + FREQUENCY_SD * rng.standard_normal(m))
    measured, wrong = exact + SHAPE_SD * rng.standard_normal(exact.shape), set()
    if fault == "spurious mode":
        at = int(rng.integers(1, m))
        between = rng.uniform(hertz[at - 1] * 1.05, hertz[at] / 1.05)
        shape = rng.standard_normal(chain.n)
        shape /= np.linalg.norm(shape)
        every = true.shapes[0] / np.linalg.norm(true.shapes[0], axis=0)
        if ((shape @ every) ** 2).max() > ALIKE:
            return None
        hertz = np.insert(hertz, at, between)
        measured = np.insert(measured, at, shape, axis=1)
        wrong = {str(at + 1)}
    elif fault:
        measured, which = break_sensor(measured, fault, rng)
        wrong = {f"s{1 + i}" for i in which}
        unit = measured / np.linalg.norm(measured, axis=0)
        mac = (unit * exact).sum(axis=0) ** 2
        if mac.min() > TOLD_MAC or ((1 - mac) / SHAPE_SD**2).sum() < TOLD:
            return None
    if (np.diff(hertz) <= 0).any():
        return None
    size = np.linalg.norm(measured, axis=0)
    test = ef.Measurements(hertz, measured, dofs=range(chain.n))
    error = error_of("shape error", inferred, delta=SHAPE_SD)
    if kind == "shapes by sensor":
        error = {"sd": SHAPE_SD * size}
    of_hertz = error_of("frequency error", inferred, relative_sd=FREQUENCY_SD)
    terms = [ef.FrequencyTerm(hertz, **of_hertz), ef.ShapeTerm(test, **error)]
    most = chain.n if 2 * len(hertz) > chain.n else 2 * len(hertz)
    return ef.PairedModel(model, test, candidates=most), terms, wrong


def deflections(chain, kind, fault, inferred, rng):
    """Simulate the deflections of all masses under two loads."""
    loads = {"middle": {chain.n // 2: 100.0}, "end": {chain.n - 1: 100.0}}
    zero = np.zeros((chain.n, chain.n))
    model = ef.StaticModel(zero, loads, chain.groups)
    exact = model(chain.truth)["displacement"][0]
    measured = exact * (1 + STATIC_SD * rng.standard_normal(exact.shape))
    wrong = set()
    if fault:
        broken, which = break_sensor(measured.T, fault, rng)
        wrong = {str(i) for i in which}
        if (((broken.T - exact) / (STATIC_SD * exact)) ** 2).sum() < TOLD:
            return None
        measured = broken.T
    error = error_of("deflection error", inferred, sd=STATIC_SD * np.abs(exact))
    term = ef.DisplacementTerm(measured, **error)
    return model, [term], wrong


def frfs(chain, kind, fault, inferred, rng):
    """Simulate FRFs between the last mass and each other."""
    modal = chain.modal()
    hertz = modal(chain.truth).frequencies[0]
    lines = np.linspace(0.7 * hertz[0], 1.1 * hertz[3], 30)
    channels = [(i, chain.n - 1) for i in range(0, chain.n)]
    model = ef.frf.FRFModel(modal, lines, channels, damping=0.02)
    H = model(chain.truth)["receptance"][0] @ [1, 1j]
    noise = (rng.standard_normal((2, *H.shape)).T @ [1, 1j]).T * np.abs(H) * FRF_SD
    measured, wrong = H + noise, set()
    if fault:
        broken, which = break_sensor(measured, fault, rng)
        if (np.abs((broken - H) / H / FRF_SD) ** 2).sum() < TOLD * 5:
            return None
        wrong = {f"{i}/{chain.n - 1}" for i in which}
        measured = broken
    data = ef.frf.FRFMeasurements(lines, measured, channels, kind="receptance")
    error = error_of("FRF error", inferred, sd=FRF_SD * np.abs(measured))
    return model, [ef.frf.FRFTerm(data, **error)], wrong


def names_rightly(diagnosis, fault, wrong):
    """Whether the record names what is wrong, and nothing else."""
    if fault == "spurious mode":
        alike = [r.label for r in diagnosis.data if r.status == RESEMBLES_NONE]
        return {*alike} == wrong
    suspects = [r.label for r in diagnosis.data if r.status == SUSPECT]
    if suspects:
        return {*suspects[0].split(" and ")} == wrong
    terms = dict.fromkeys(r.term for r in diagnosis.data)
    for term in terms:
        found = find_farthest([r for r in diagnosis.data if r.term == term])
        at = [r.label for r in found if r.kind in ("sensor", "point", "channel")]
        if at and {*at[0].split(" and ")} <= wrong:
            return True
    return False


def sample_and_judge(posterior, truth, seed):
    """Return the diagnosis of a short chain, which starts about the truth."""
    starts = posterior.start(WALKERS, seed)
    rng = np.random.default_rng(seed)
    for i, name in enumerate(truth):
        starts[:, i] = truth[name] * (1 + 0.02 * rng.standard_normal(WALKERS))
    options = {"ensembles": 1, "seed": seed, "starts": starts[None], "progress": False}
    with warnings.catch_warnings():  # by which a run names suspect sensors before
        warnings.filterwarnings("ignore", "sensor")
        run = ef.run(posterior, ef.DEMCMove(), WALKERS, 2 * BURN_IN, **options)
    return ef.diagnose(run, discard=BURN_IN)


def study(right, wrong, first):
    """Return the outcome of each test, the right ones first."""
    rows = []
    for i in range(right):
        kind, inferred = KINDS[i % 5], i // 5 % 2 == 1
        rng = np.random.default_rng([first, i])
        posterior, truth, _ = simulate(kind, "", inferred, rng)
        status = sample_and_judge(posterior, truth, i).fit.status
        rows.append(Outcome(kind, "right", inferred, status, False))
    for i in range(wrong):
        fault, inferred = FAULTS[i % 5], i // 5 % 2 == 1
        kind = KINDS[1:][i // 20 % 4] if i // 10 % 2 == 0 else KINDS[1]
        kind = KINDS[1] if fault == "spurious mode" else kind
        rng = np.random.default_rng([first, right + i])
        posterior, truth, what = simulate(kind, fault, inferred, rng)
        found = sample_and_judge(posterior, truth, i)
        named = found.fit.status == "does not fit" and names_rightly(found, fault, what)
        rows.append(Outcome(kind, fault, inferred, found.fit.status, named))
    return rows


def main(right: int = 200, wrong: int = 100, first: int = 2026):
    """Print how many right tests are let pass, and how many wrong ones are named."""
    outcomes, rows = study(right, wrong, first), []
    for fault in ("right", *FAULTS):
        for error, inferred in (("known", False), ("inferred", True)):
            of = [o for o in outcomes if (o.fault, o.inferred) == (fault, inferred)]
            if of:
                counts = [sum(o.status == status for o in of) for status in STATUSES]
                named = [sum(o.named for o in of)]
                rows.append((fault, error, len(of), *counts, *named))
    titles = ["test", "errors", "tests", *STATUSES, "named"]
    columns = dict.fromkeys(titles[:2], "") | dict.fromkeys(titles[2:], "d")
    return tabulate("The statement on the fit of simulated tests", columns, rows)


if __name__ == "__main__":
    command(main)
