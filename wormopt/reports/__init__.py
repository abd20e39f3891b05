"""Results as a page to read and to send: one HTML file that needs nothing from elsewhere."""
