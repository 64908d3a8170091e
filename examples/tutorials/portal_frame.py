# %% [markdown]
# # A portal frame, from the laboratory's table
#
# For a first update of your own: the structure that every engineer draws, and a table
# as a laboratory writes it. Two columns and a beam of reinforced concrete were tested
# with six accelerometers. What are the moduli of the columns and of the beam, and how
# sure is that? The test is simulated, with 25.5 GPa in the columns and 33 GPa in the
# beam. `python examples/tutorials/portal_frame.py` runs the page: it prints the tables,
# and leaves a figure and a report in `figures/portal_frame`. Copy it for a frame of
# your own.
#
# ## What the laboratory sent
#
# Three heading lines, modes in rows, decimal commas:

# %%
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

import emcee_femu as ef

directory = Path("figures/portal_frame")
directory.mkdir(parents=True, exist_ok=True)
path = directory / "test.csv"
path.write_text("""\
Modal test of a portal frame;;;;;;;;
hall 2, instrumented hammer, 3 repetitions;;;;;;;;
A: accelerometer, positive to the right or upwards;;;;;;;;
Mode;f [Hz];s [Hz];A1;A2;A3;A4;A5;A6
1;7,43;0,022;0,47;1,00;0,46;-0,01;0,04;0,04
2;22,61;0,068;0,28;0,01;-0,23;0,49;1,00;0,48
3;55,61;0,167;1,00;-0,24;1,00;0,47;0,04;-0,34
4;57,79;0,173;-0,94;-0,01;1,00;0,00;0,31;0,02
""")
table = pd.read_csv(path, sep=";", decimal=",", skiprows=3, index_col="Mode")
print(table)

# %% [markdown]
# ## The model
#
# `plane="xz"` makes a plane frame: nodes have two coordinates, sections one second
# moment of area, and there are no DOFs out of the plane. Lengths are in m, forces in N,
# densities in kg/m³. `(1e9, "columns")` is 10⁹ times a parameter, so that the moduli are
# in GPa. Bars are divided so that the frame can bend in between.
#
# If the feet may turn, support them as `"pinned"`, with a rotational spring to the ground
# (`None`) whose stiffness is a parameter, `"base"` in MN m/rad:
#
# ```python
# supports = {0: "pinned", 14: "pinned"}
# springs = [(foot, None, {"ry": (1e6, "base")}) for foot in supports]
# model = ef.FrameModel(nodes, bars, sections, supports, springs=springs, **frame)
# ```

# %%
HEIGHT, SPAN = 4.0, 6.0  # m
left = [(0, z) for z in np.linspace(0, HEIGHT, 5)]
top = [(x, HEIGHT) for x in np.linspace(0, SPAN, 7)[1:-1]]
right = [(SPAN, z) for z in np.linspace(HEIGHT, 0, 5)]
nodes = left + top + right  # 0 to 4, 5 to 9, 10 to 14
bars = [(i, i + 1, "beam" if 4 <= i < 10 else "column") for i in range(14)]
sections = {
    "column": ef.Section(E=(1e9, "columns"), rho=2500, A=0.3 * 0.3, I=0.3**4 / 12),
    "beam": ef.Section(E=(1e9, "beam"), rho=2500, A=0.3 * 0.4, I=0.3 * 0.4**3 / 12),
}
supports = {0: "fixed", 14: "fixed"}
frame = {"plane": "xz", "n_modes": 8, "shapes": True}
model = ef.FrameModel(nodes, bars, sections, supports, **frame)
nominal = {"columns": np.array([30.0]), "beam": np.array([30.0])}
print(model(nominal).frequencies[0, :4].round(2), "Hz at 30 GPa")

# %% [markdown]
# ## The test, in the words of the model
#
# Say where each sensor is: `"2:ux"` is the displacement of node 2 along x. One that
# points the other way has a sign, `"2:-ux"`; one that is skew, or a strain gauge, is a
# [combination of DOFs](../how_to/sensors.py).

# %%
places = {"A1": "2:ux", "A2": "4:ux", "A3": "12:ux"}
places |= {"A4": "5:uz", "A5": "7:uz", "A6": "9:uz"}
test = ef.Measurements(
    table["f [Hz]"],
    shapes=table[[*places]].T,  # one row per sensor, one column per mode
    sd=table["s [Hz]"],
    sensors=[*places],
    dofs=[*places.values()],
)
paired = ef.PairedModel(model, test)
pairing = paired(nominal)
print("model's modes", pairing.model_mode[0], " MAC", pairing.mac[0].round(2))

# %% [markdown]
# Each measured mode has found one of the model that looks like it: a MAC of 1 is the
# same shape. Modes 3 and 4 are close, so that frequencies alone would not tell them
# apart if the moduli changed.
#
# ## What is known before, and the posterior
#
# Concrete has 30 GPa, give or take 20 %. Frequencies have the laboratory's standard
# deviation.

# %%
moduli = dict.fromkeys(model.names, stats.lognorm(0.2, scale=30))  # GPa
prior = ef.IndependentPrior(moduli)
units = dict.fromkeys(model.names, "GPa")
posterior = ef.LogPosterior(paired, ef.FrequencyTerm(test), prior, units)
print(ef.check_test(posterior))

# %% [markdown]
# No sensor seems to be wrong, by one solve at the prior mean. Now for the samples:

# %%
run = ef.run(posterior, seed=1)
diagnosis = ef.diagnose(run)
print(diagnosis)

# %% [markdown]
# The three statements say whether the result may be used: the chains have converged,
# the search has found all maxima that are not very small, and the model predicts what
# was measured.
#
# ## The answer

# %%
print(ef.parameter_table(run), ef.frequency_table(run), sep="\n\n")

# %% tags=["result"] mystnb={"image": {"alt": "Four mode shapes of the portal frame in its plane: sway, bending of the beam, and two with bent columns; red dots of six sensors lie on the blue updated model"}}
ef.figures.plot_shapes(run).savefig(directory / "shapes.png")

# %% [markdown]
# One HTML file has all of it, to hand over (`pip install jinja2`):

# %%
print(ef.report(run, directory / "report.html", title="Portal frame"))

# %% [markdown]
# {doc}`modal_test` goes further: a frame in space, an inferred error of the model, and
# what to look at if the fit is bad.

# %% tags=["remove-cell"]
assert diagnosis.converged
means = dict(zip(model.names, ef.parameter_table(run).column("mean"), strict=True))
assert abs(means["columns"] - 25.5) < 0.5 and abs(means["beam"] - 33.0) < 1.0
assert pairing.mac.min() > 0.9
