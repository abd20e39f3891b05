"""Time integration: any Model or gait in, an event-located motion out."""
