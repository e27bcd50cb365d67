"""Yarns on a deformed cloth: the relaxed yarns of the cell, mapped onto the mesh by its local strain."""
