"""Stanford PLY."""
