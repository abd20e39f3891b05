"""Bounds of every gait by one linear program, certificates of them, and their verification."""
