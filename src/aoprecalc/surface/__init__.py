"""The surface itself: its normals and how it hangs together."""
