"""Clothes and the body that wears them: panels, seams, ready garments, a mannequin."""
