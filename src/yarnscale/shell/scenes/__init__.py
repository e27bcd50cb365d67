"""Scenes: what is set up, how long it runs and what is measured; ready ones."""
