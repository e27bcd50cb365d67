"""Contact of cloth with itself and with obstacles: search, distances, barrier, friction."""
