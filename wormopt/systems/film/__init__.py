"""Films of magnetic fluid: waves, what they carry, how they settle, the best wave."""
