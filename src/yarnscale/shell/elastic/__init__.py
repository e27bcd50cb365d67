"""From a mesh to its elastic energy: strains, elements, moduli, compiled loops."""
