"""One periodic cell of yarn under a macroscopic state."""
