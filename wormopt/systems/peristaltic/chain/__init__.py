"""Segments in a row as a Model of rings, on the ground or in a tube; waves; crawling."""
