"""Virtual tests of fabrics: tension, shear, bending, curl, drape, of cells of yarns and of shell materials alike."""
