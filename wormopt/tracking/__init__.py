"""Control that makes a worm follow a gait: (plant Model, Reference) -> closed-loop Model."""
