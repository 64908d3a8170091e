import matplotlib

matplotlib.use("Agg")  # no display on a server
