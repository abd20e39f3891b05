"""The verb simulate: motions in time, contacts exact or smooth, events located."""
