"""The worm on drag that hangs on length: its Model, its best small and large gaits."""
