"""Contact of cloth with itself and with bodies: search, distances, barrier, friction."""
