"""Virtual sensors of the twin on the virtual road."""
