"""One piece of fabric with the same strain everywhere, of yarns or of shell, under loads."""
