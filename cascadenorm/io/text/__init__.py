"""Text files of which single numbers are replaced and nothing else."""
