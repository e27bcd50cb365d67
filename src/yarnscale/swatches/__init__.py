"""From measured swatches to a shell model and to yarn parameters."""
