"""One yarn, and how yarns cross: patterns, yarn materials, rod and contact energies."""
