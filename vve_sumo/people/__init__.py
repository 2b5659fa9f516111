"""A real person on the virtual road: reports of position, what is believed of them, and the distance from the car."""
