"""The worm on length-dependent drag: its Model, its best small and large gaits."""
