"""Cloth in time: what acts on it, one step, a run of steps, equilibria under a growing load."""
