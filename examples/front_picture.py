"""The picture of the front page: mode shapes on the structure, and the frequencies.

It runs the tutorial on a modal test. It draws two mode shapes with the measurements
of the sensors, beside the six frequencies before and after updating.

Run it:  python examples/front_picture.py  (20 s; writes .github/images/front.png)
"""

import runpy
from pathlib import Path

import matplotlib

matplotlib.use("Agg")  # figures go to files

import numpy as np
from matplotlib import pyplot as plt

import emcee_femu as ef
from emcee_femu.figures.style import BELOW, BLUE, RED

ROOT = Path(__file__).parents[1]
DPI = 200


def plot_frequencies(idata, height):
    """Draw the error of each frequency before and after updating."""
    before = ef.frequency_table(idata)
    after = ef.predictive_table(idata)  # with intervals of a new measurement
    measured = np.array(after.column("measured Hz"))
    columns = [before.column("prior mean Hz")[: len(measured)]]
    columns += map(after.column, ["updated Hz", "2.5 %", "97.5 %"])
    initial, mean, low, high = 100 * (np.array(columns) / measured - 1)
    figure, axes = plt.subplots(figsize=(4.1, height), layout="constrained")
    place = np.arange(1, len(measured) + 1)
    axes.axhline(0, color="black", lw=0.8)
    axes.vlines(place, low, high, color=BLUE, lw=5, label="new test, 95 %")
    axes.plot(place, mean, "o", mfc="white", mec=BLUE, ms=5, label="updated model")
    style = {"mfc": "white", "mec": RED, "ms": 7}
    axes.plot(place, initial, "D", label="before updating", **style)
    axes.set_xticks(place, [f"{i + 1}\n{f:.2f}" for i, f in enumerate(measured)])
    axes.set_xlabel("mode, measured frequency [Hz]")
    axes.set_ylabel("error of the frequency [%]")
    axes.grid(True, axis="y", alpha=0.25)
    sizes = [np.abs(errors).mean() for errors in (initial, mean)]
    title = "mean error of the frequencies:\n{:.1f} % before, {:.1f} % after"
    axes.set_title(title.format(*sizes), fontsize=9)
    figure.legend(**BELOW | {"ncols": 3, "columnspacing": 1.0}, fontsize=8)
    return figure


def main(output=ROOT / ".github" / "images" / "front.png"):
    """Run the tutorial, draw both figures, and join them."""
    plt.rcParams["font.size"] = 9
    page = runpy.run_path(str(ROOT / "examples" / "tutorials" / "modal_test.py"))
    shapes = ef.figures.plot_shapes(page["run"], modes=[1, 3])
    frequencies = plot_frequencies(page["idata"], shapes.get_size_inches()[1])
    print(frequencies.axes[0].get_title())
    pictures = []
    for figure in (shapes, frequencies):
        figure.set_dpi(DPI)
        figure.canvas.draw()
        pictures.append(np.asarray(figure.canvas.buffer_rgba())[..., :3])
    plt.imsave(output, np.hstack(pictures))
    print(f"Written to {output}")


if __name__ == "__main__":
    main()
