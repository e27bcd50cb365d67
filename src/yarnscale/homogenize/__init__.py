"""From a periodic cell to a shell material: sampling, storing, fitting."""
