"""Finite fabrics: yarns at full length, and the bounding volume that reduces their unknowns (LOD03)."""
