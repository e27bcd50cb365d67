"""Cloth that meets itself and bodies: search, distances, barrier, friction."""
