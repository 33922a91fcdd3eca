"""What optional packages build on besides the public API and `fitting.text`; provisional.

command   options, progress and results of a command
report    tables, screens and pages from templates
drawing   how figures look
problem   a fit from within: rows, derivatives, covariance
records   campaigns, kinds of measurements, the reader of instruments' tables
fmu       runs of an FMU, and the places where independent items run

Nothing in the core imports it. Names may move from one release to the next: what a second package
needs belongs here, what one needs does not.
"""
