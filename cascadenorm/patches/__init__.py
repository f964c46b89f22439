"""Work on a mesh in memory, patch by patch, so that its working arrays are those of one patch."""
