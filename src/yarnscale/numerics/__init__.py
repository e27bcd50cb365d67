"""Energies of small stencils, their assembly, and their minimisation; knows neither yarn nor cloth."""
