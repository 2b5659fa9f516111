"""What the twin's sensors make of the street around it."""
