"""How close methods come to the true surface."""
