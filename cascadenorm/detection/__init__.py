"""What kind of surface and what kind of error a mesh has."""
