"""Magnetisable worms in a channel: closed forms, shapes of a segment, rods."""
