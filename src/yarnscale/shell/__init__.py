"""Cloth as a surface: meshes, fundamental forms, materials and their simulation."""
