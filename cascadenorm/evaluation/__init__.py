"""Methods measured: metrics, folders of noisy/clean pairs, and the harness that runs one on the other."""
