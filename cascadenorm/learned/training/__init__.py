"""Training of the networks; only modules in here import torch."""
