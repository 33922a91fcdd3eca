"""Draws from a posterior: how they are made, when there are enough, and what they say.

minima.py       where walkers set out: minima, polished, with their widths
start.py        draws about many places at once, by which walkers change from one to another
first_walks.py  the same about places of a first walk, where the posterior is bent
learnt.py       what a mixture is worth, and the parts of one about places
chain.py        the sampler, the one door to ``emcee``
diagnostics.py  correlation of a chain with itself, agreement of its walkers
reach.py        values that the fit accepts and no draw is near
summary.py      what is told: values with intervals, shares of minima
outputs.py      derived outputs at the draws
ranks.py        simulation-based calibration

Nothing here knows an FMU: a posterior is a function of parameters.
"""
