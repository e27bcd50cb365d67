"""One yarn, and how yarns touch: patterns, yarn materials, rod and contact energies, close pairs."""
