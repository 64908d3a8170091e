# %% [markdown]
# # CalculiX, end to end
#
# A steel beam of three parts is clamped at one end and rests on an elastic bearing at
# the other. Six measured frequencies (simulated here), three of each bending plane, are
# to determine the stiffness of the three parts and of the bearing. CalculiX solves the
# beam with solid elements, as a program that is started anew for each solve. The page
# updates it both ways:
#
# - **(a) as a black box**: the frequencies are read from its output, `emulate` learns
#   them from some tens of solves, and `certify` checks the posterior with some more;
# - **(b) by its matrices**: CalculiX writes K and M five times; the model made of them
#   is reduced and sampled without the program.
#
# Both must give the same posterior. CalculiX is free software:
# `apt install calculix-ccx`. `python examples/how_to/calculix.py` runs this page.
# For a better certificate, a study would use 100 checks.

# %% tags=["remove-cell"]
import sys
from pathlib import Path

if "__file__" in globals():  # as a script: the driver is in the folder above
    sys.path.append(str(Path(__file__).parents[1]))

# %%
import itertools
import tempfile
import textwrap
from functools import partial
from pathlib import Path

import numpy as np
from calculix_program import find_command, finished_job, read_frequencies

import emcee_femu as ef

SOLVES, CHECKS = 60, 60
TRUTH = {"root": 0.8, "middle": 1.05, "tip": 0.95, "bearing": 0.7}
PARTS = ("root", "middle", "tip")
BOUNDS = dict.fromkeys(PARTS, (0.5, 1.5)) | {"bearing": (0.2, 2.0)}
SD = (0.15, 0.15, 0.15, 0.4)  # of the prior, about factors of 1
N_MODES, NOISE = 6, 0.005  # relative standard deviation of a measured frequency
SIZE, E, NU, RHO = (3.0, 0.08, 0.10), 210e9, 0.3, 7850.0  # m, Pa, -, kg/m3
BEARING = 2e5  # N/m
ELEMENTS = (12, 2, 2)  # along, across, up
MATRICES = "*FREQUENCY,SOLVER=MATRIXSTORAGE"
CORNERS = ((0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0))
CORNERS += tuple((x, y, 2) for x, y, _ in CORNERS)
EDGES = "01 12 23 30 45 56 67 74 04 15 26 37".split()

# %% [markdown]
# `calculix_program` is the driver, a file to copy beside your own script:
# {download}`calculix_program.py <../../examples/calculix_program.py>`. {doc}`black_box`
# explains its lines.
#
# ````{dropdown} The driver: start the program, wait for it, end it
# ```{literalinclude} ../../examples/calculix_program.py
# :language: python
# :start-at: "@contextmanager"
# :end-before: "def read_frequencies"
# ```
# ````
#
# The units are SI; the factors multiply the stiffness of each part. The measured
# frequencies are simulated: those of CalculiX at the true factors, with 0.5 % of noise.
# A real structure also deviates from its model, and 0.5 % would then be too little.
#
# ## The input file
#
# Put your own template here, with numbers where the parameters are. With CalculiX, mind:
#
# - **Numbers.** After `*SPRING`, CalculiX 2.20 takes a number without a decimal point for
#   a direction. It reads 20 characters of a number, so write `.10e`.
# - **Elements.** One row of C3D20R is refused ({doc}`matrices`): use two, or C3D20.
# - **Order.** The bearing lifts only vertical modes, so the order of the six never changes
#   within the bounds. If it may, measure shapes, and put a
#   {py:class}`~emcee_femu.PairedModel` around the function.


# %%
def deck(theta, procedure="*FREQUENCY"):
    """Return the input file for factors theta."""
    ranges = [range(2 * n + 1) for n in ELEMENTS]
    grid = itertools.product(*ranges)
    places = [p for p in grid if sum(i % 2 for i in p) <= 1]
    nodes = {place: number for number, place in enumerate(places, 1)}
    half = np.divide(SIZE, np.multiply(2, ELEMENTS))
    lines = ["*NODE"]
    for place, number in nodes.items():
        lines.append(f"{number}," + ",".join(f"{x:.10e}" for x in half * place))
    middles = [np.add(CORNERS[int(a)], CORNERS[int(b)]) // 2 for a, b in EDGES]
    own = [*CORNERS, *middles]  # the 20 nodes of C3D20R, from its first corner
    element = itertools.count(1)
    thirds = np.split(np.arange(ELEMENTS[0]), 3)
    for part, stations in zip(PARTS, thirds, strict=True):
        lines.append(f"*ELEMENT,TYPE=C3D20R,ELSET={part}")
        for first in itertools.product(stations, *map(range, ELEMENTS[1:])):
            places = (tuple(np.multiply(2, first) + place) for place in own)
            line = [next(element), *(nodes[place] for place in places)]
            lines.append(",".join(map(str, line[:16])) + ",")
            lines.append(",".join(map(str, line[16:])))
        lines += [f"*MATERIAL,NAME={part}", "*ELASTIC"]
        lines += [f"{theta[part] * E:.10e},{NU}", "*DENSITY", f"{RHO}"]
        lines += [f"*SOLID SECTION,ELSET={part},MATERIAL={part}"]
    end = 2 * ELEMENTS[0]
    resting = [n for (x, _, z), n in nodes.items() if x == end and z == 0]
    lines += ["*ELEMENT,TYPE=SPRING1,ELSET=bearing"]
    lines += [f"{next(element)},{node}" for node in resting]
    spring = theta["bearing"] * BEARING / len(resting)
    lines += ["*SPRING,ELSET=bearing", "3", f"{spring:.10e}", "*BOUNDARY"]
    lines += [f"{node},1,3" for (x, _, _), node in nodes.items() if x == 0]
    lines += ["*STEP", procedure, f"{N_MODES}", "*END STEP", ""]
    return "\n".join(lines)


# %% [markdown]
# ## A solve, and an export
#
# With `*FREQUENCY, SOLVER=MATRIXSTORAGE` the same program writes K and M instead. One
# export with all factors 1 and one per factor doubled make a
# {py:class}`~emcee_femu.MatrixModel`.


# %%
def solve(theta, command, scratch):
    """Return the frequencies in Hz that CalculiX prints for factors theta."""
    with finished_job(deck(theta), command, scratch=scratch) as folder:
        printed = (folder / "job.dat").read_text(encoding="utf-8")
        return read_frequencies(printed, N_MODES)


def export(theta, command, scratch):
    """Return the matrices that CalculiX writes for factors theta."""
    exporting = deck(theta, MATRICES)
    with finished_job(exporting, command, scratch=scratch) as folder:
        return ef.read_matrices(folder / "job.sti")


def by_matrices(command, scratch):
    """Return the model of five exports: factors 1, and each doubled in turn."""
    ones = dict.fromkeys(TRUTH, 1.0)
    base = export(ones, command, scratch)
    changed = {name: {**ones, name: 2.0} for name in TRUTH}
    doubled = {k: {2.0: export(p, command, scratch)} for k, p in changed.items()}
    return ef.MatrixModel.from_differences(base, doubled, n_modes=N_MODES)


# %% [markdown]
# ## (a) The program as a black box
#
# The remaining cells are inside `if __name__ == "__main__":`, because `workers=2` starts
# processes.

# %%
if __name__ == "__main__":
    command, rng = find_command(), np.random.default_rng(1)
    scratch = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
    function = partial(solve, command=command, scratch=scratch.name)
    noise = 1 + NOISE * rng.standard_normal(N_MODES)
    term = ef.FrequencyTerm(function(TRUTH) * noise, relative_sd=NOISE)
    prior = ef.GaussianPrior([*TRUTH], [1.0] * 4, SD, [*BOUNDS.values()])
    posterior = ef.LogPosterior(ef.FunctionModel(function, N_MODES), term, prior)

    options = {"seed": 1, "workers": 2, "on_failure": "reject"}
    emulated = ef.emulate(posterior, SOLVES, **options)
    run = ef.run(emulated.posterior, seed=1)
    idata = ef.to_inference_data(run)
    certificate = ef.certify(idata, posterior, CHECKS, **options)
    print(emulated.history)
    print(textwrap.fill(certificate.verdict, 80))

# %% [markdown]
# `emulate` stopped long before it had used all allowed solves.
#
# ## (b) By its matrices
#
# The seed is another: chains with the same random numbers would agree for that reason.

# %%
if __name__ == "__main__":
    full = by_matrices(command, scratch.name)
    reduced = ef.reduce_model(full, BOUNDS, tolerance=1e-5)
    exact = ef.LogPosterior(reduced, term, prior)
    exactly = ef.run(exact, seed=2)
    diagnosis = ef.diagnose(exactly)
    print(f"{reduced.full_size} DOFs reduced to {reduced.size} basis vectors")
    print(f"largest frequency error {reduced.max_error:.1e}")
    print(textwrap.fill(diagnosis.verdict, 80))

# %% [markdown]
# ## One posterior?
#
# z is the difference over its standard error, of the certificate and of chain (b)
# together.

# %% tags=["result"]
if __name__ == "__main__":
    draws = np.concatenate([sampler.get_chain(flat=True) for sampler in exactly])
    mean, sd = draws.mean(axis=0), draws.std(axis=0)
    error = np.hypot(certificate.mean_error, sd / np.sqrt(diagnosis.ess_bulk))
    z = (certificate.mean - mean) / error
    print(ef.parameter_table(exactly, true=TRUTH))
    print("z of the means:", z.round(1))
    print("sd, (a) over (b):", (certificate.sd / sd).round(2))
    solves = emulated.solves + certificate.solves
    print(f"(a) {solves} solves of CalculiX, (b) 5")


# %% tags=["remove-cell"]
if __name__ == "__main__":
    scratch.cleanup()
    assert certificate.short == "certified" and solves <= 110
    assert np.abs(z).max() < 4
    assert reduced.max_error <= 1e-5
