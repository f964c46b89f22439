"""What methods do with malformed input, and with meshes of other libraries."""
