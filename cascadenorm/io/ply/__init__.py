"""PLY, as text and binary."""
