"""Energy densities of the fundamental forms: homogenized splines and orthotropic fabrics."""
