"""Parts of pictures that are not yet pages of panels."""
