"""Fit the parameters of an FMU to driven measurements.

Knows FMI and a campaign file; everything about the model comes from its modelDescription.xml.
"""

__version__ = "0.2.0"
