"""`wormopt stress`: hard cases of everything, each compared with a route that shares no code."""
