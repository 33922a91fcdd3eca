"""Figures to zoom, read off and toggle on a page: the drawn ones, handed to Bokeh."""
