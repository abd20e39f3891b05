"""What rests: profiles that hold a given area, along a load; rods between given ends."""
