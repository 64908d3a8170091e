"""The search of "auto": stages on one archive, and what they are made of.

No chain is sampled or judged here.
"""
