"""Worms driven by masses that swing inside, or about their centre as prescribed."""
