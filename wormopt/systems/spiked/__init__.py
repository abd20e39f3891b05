"""Worms with spikes whose gait is prescribed: motion, design, certificates, stepping motors."""
