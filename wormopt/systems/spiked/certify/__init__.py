"""Bounds on every gait by one linear program, their certificates, and the verification."""
