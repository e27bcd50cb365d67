"""Finite fabrics: yarns at full length, and the bounding volume that stands in for them (LOD03)."""
