"""Training of the networks. Only modules in this folder import torch."""
