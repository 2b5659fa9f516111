"""Virtual sensors of the twin in the virtual road."""
