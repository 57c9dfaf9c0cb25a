"""OpenGL without a screen: contexts and programs."""
