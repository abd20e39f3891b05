"""Motions determined by pins and skids, and the loads of these."""
