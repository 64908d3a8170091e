"""Run emcee: starts, recipes, files that survive a kill, pools."""
