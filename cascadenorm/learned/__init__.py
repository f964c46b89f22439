"""Cascaded normal regression: descriptors, clusters, networks, cascade, training."""
