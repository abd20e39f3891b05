"""Two masses on a magneto-elastic link."""
