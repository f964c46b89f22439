"""Text files in which single numbers are replaced."""
