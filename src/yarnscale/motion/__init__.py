"""What moves, whatever it is made of: steps, the run of a schedule, equilibria under a load, prescribed motions."""
