"""Captures of simulated machines, planted effects included: the adversary of the estimator and of the effect finder.

Nothing here imports the product. The integrator, the formulas and the capture writer are written a second time from
the paper and the capture format, so that an error of the product cannot cancel itself in its own tests.
"""
