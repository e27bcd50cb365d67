"""Yarn geometry from photographs of a fabric (EST22 §4.2)."""
