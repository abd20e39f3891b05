"""Results as a page to read and send: one self-contained HTML file."""
